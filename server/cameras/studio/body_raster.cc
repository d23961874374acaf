#include "server/cameras/studio/body_raster.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include "server/cameras/studio/room.h"

namespace kinevox::studio {
namespace {

constexpr float kNear_m = 0.15f;
constexpr float kNothing = std::numeric_limits<float>::infinity();
// Vectors of GCC and Clang: SSE on x86, NEON on ARM.
using Float4 = float __attribute__((vector_size(16)));
using Int4 = std::int32_t __attribute__((vector_size(16)));

}  // namespace

void BodyRaster::project(const Camera& camera, const SkinnedBody& body) {
    const Lens lens(camera);
    seen_.resize(body.vertices.size());
    float x0 = 1e9f, y0 = 1e9f, x1 = -1e9f, y1 = -1e9f;
    for (std::size_t i = 0; i < body.vertices.size(); ++i) {
        seen_[i] = lens.project(body.vertices[i]);
        if (!(seen_[i].z > kNear_m)) continue;
        x0 = std::min(x0, seen_[i].x);
        x1 = std::max(x1, seen_[i].x);
        y0 = std::min(y0, seen_[i].y);
        y1 = std::max(y1, seen_[i].y);
    }
    const auto inside = [](float v, int size) {
        return static_cast<int>(std::clamp(v, 0.0f, static_cast<float>(size)));
    };
    box_ = {inside(std::floor(x0), camera.width), inside(std::floor(y0), camera.height),
            inside(std::ceil(x1) + 1, camera.width), inside(std::ceil(y1) + 1, camera.height)};
    if (x0 > x1 || box_.empty()) box_ = {};
}

void BodyRaster::draw(const Camera& camera, const BodyMesh& mesh, const SkinnedBody& body,
                      const std::vector<Vec3f>& shown_light) {
    mesh_ = &mesh;
    light_ = &shown_light;
    project(camera, body);
    if (box_.empty()) return;
    const int wide = kSamples * (box_.x1 - box_.x0), high = kSamples * (box_.y1 - box_.y0);
    stride_ = (wide + 7) / 4 * 4;
    depth_.assign(static_cast<std::size_t>(stride_) * high, kNothing);
    texel_.resize(depth_.size());
    // Sample s of an axis lies at pixel (s + 0.5) / kSamples - 0.5.
    const float shift_x = kSamples * (0.5f - static_cast<float>(box_.x0)) - 0.5f;
    const float shift_y = kSamples * (0.5f - static_cast<float>(box_.y0)) - 0.5f;
    for (Vec3f& p : seen_) p = {kSamples * p.x + shift_x, kSamples * p.y + shift_y, p.z};
    const auto& triangles = mesh.surface.triangles;
    for (std::size_t t = 0; t < triangles.size(); ++t) {
        const Vec3f a = seen_[triangles[t][0]], b = seen_[triangles[t][1]], c = seen_[triangles[t][2]];
        // Seen from outside a triangle runs clockwise in a image whose v points down.
        const float area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if (!(area < -1e-9f) || !(a.z > kNear_m && b.z > kNear_m && c.z > kNear_m)) continue;
        fill(a, b, c, 1.0f / area, static_cast<std::int32_t>(t), wide, high);
    }
}

// Four samples of a row at a time: whether a sample lies inside cannot be predicted, so nothing branches on
// it.
inline void BodyRaster::fill(Vec3f a, Vec3f b, Vec3f c, float inverse_area, std::int32_t triangle, int wide,
                             int high) {
    constexpr float kHair = 1e-3f, kAlmostOne = 0.9999f;
    const float low_x = std::max(std::min(a.x, std::min(b.x, c.x)) - kHair, 0.0f);
    const float high_x = std::min(std::max(a.x, std::max(b.x, c.x)) + kHair, static_cast<float>(wide - 1));
    const float low_y = std::max(std::min(a.y, std::min(b.y, c.y)) - kHair, 0.0f);
    const float high_y = std::min(std::max(a.y, std::max(b.y, c.y)) + kHair, static_cast<float>(high - 1));
    const int x0 = static_cast<int>(low_x + kAlmostOne), x1 = static_cast<int>(high_x);
    const int y0 = static_cast<int>(low_y + kAlmostOne), y1 = static_cast<int>(high_y);
    if (high_x < low_x || high_y < low_y || x0 > x1 || y0 > y1) return;
    // Weights of b and c: b1 = ((p - a) x (c - a)) / area, b2 = ((b - a) x (p - a)) / area.
    const float b1_dx = (c.y - a.y) * inverse_area, b1_dy = -(c.x - a.x) * inverse_area;
    const float b2_dx = -(b.y - a.y) * inverse_area, b2_dy = (b.x - a.x) * inverse_area;
    const float depth_b = b.z - a.z, depth_c = c.z - a.z;
    const Float4 ramp{0, 1, 2, 3};
    const Float4 zero{};
    for (int y = y0; y <= y1; ++y) {
        const float px = static_cast<float>(x0) - a.x, py = static_cast<float>(y) - a.y;
        Float4 b1 = (b1_dx * px + b1_dy * py) + b1_dx * ramp, b2 = (b2_dx * px + b2_dy * py) + b2_dx * ramp;
        const std::size_t row = static_cast<std::size_t>(y) * static_cast<std::size_t>(stride_);
        for (int x = x0; x <= x1; x += 4, b1 += 4 * b1_dx, b2 += 4 * b2_dx) {
            Float4 old_depth;
            Int4 old_texel;
            std::memcpy(&old_depth, &depth_[row + x], sizeof old_depth);
            std::memcpy(&old_texel, &texel_[row + x], sizeof old_texel);
            const Float4 depth = a.z + b1 * depth_b + b2 * depth_c;
            const Int4 drawn = (b1 >= -1e-4f) & (b2 >= -1e-4f) & (b1 + b2 <= 1.0001f) & (depth < old_depth);
            const Float4 u = 3.999f * (b1 > zero ? b1 : zero), v = 3.999f * (b2 > zero ? b2 : zero);
            const Int4 texel = kTexelsPerTriangle * triangle +
                               kTexelsAcross * __builtin_convertvector(u, Int4) +
                               __builtin_convertvector(v, Int4);
            const Float4 new_depth = drawn ? depth : old_depth;
            const Int4 new_texel = drawn ? texel : old_texel;
            std::memcpy(&depth_[row + x], &new_depth, sizeof new_depth);
            std::memcpy(&texel_[row + x], &new_texel, sizeof new_texel);
        }
    }
}

void BodyRaster::blend_row(int y, std::uint16_t* bgr) const {
    const std::size_t first =
        static_cast<std::size_t>(kSamples * (y - box_.y0)) * static_cast<std::size_t>(stride_);
    for (int x = box_.x0; x < box_.x1; ++x) {
        const std::size_t corner = first + static_cast<std::size_t>(kSamples * (x - box_.x0));
        const float* near = &depth_[corner];
        const float nearest =
            std::min(std::min(near[0], near[1]), std::min(near[stride_], near[stride_ + 1]));
        if (nearest == kNothing) continue;
        const float farthest =
            std::max(std::max(near[0], near[1]), std::max(near[stride_], near[stride_ + 1]));
        const bool whole = farthest != kNothing;
        int hits = 0, sum_b = 0, sum_g = 0, sum_r = 0;
        std::int32_t lit = 0;
        for (const std::size_t i : {corner, corner + 1, corner + stride_, corner + stride_ + 1}) {
            if (!whole && depth_[i] == kNothing) continue;
            lit = texel_[i];
            const Texel texel = mesh_->texels[static_cast<std::size_t>(lit)];
            sum_b += texel.b;
            sum_g += texel.g;
            sum_r += texel.r;
            ++hits;
        }
        // Light changes slowly: one sample's stands for the pixel.
        const Vec3f light = (*light_)[static_cast<std::size_t>(lit / kTexelsPerTriangle)];
        constexpr int kAll = kSamples * kSamples;
        const float keep = static_cast<float>(kAll - hits) / kAll,
                    scale = static_cast<float>(kGreyScale) / kAll;
        constexpr float kWhite = 255.0f * kGreyScale;
        std::uint16_t* out = bgr + 3 * x;
        out[0] = static_cast<std::uint16_t>(
            std::min(keep * out[0] + scale * light.z * static_cast<float>(sum_b), kWhite));
        out[1] = static_cast<std::uint16_t>(
            std::min(keep * out[1] + scale * light.y * static_cast<float>(sum_g), kWhite));
        out[2] = static_cast<std::uint16_t>(
            std::min(keep * out[2] + scale * light.x * static_cast<float>(sum_r), kWhite));
    }
}

void BodyRaster::label(const Camera& camera, const BodyMesh& mesh, const SkinnedBody& body,
                       const std::vector<std::uint8_t>& labels, std::vector<std::uint8_t>& out) {
    project(camera, body);
    const std::size_t pixels = static_cast<std::size_t>(camera.width) * camera.height;
    out.assign(pixels, 0);
    depth_.assign(pixels, kNothing);
    const auto& triangles = mesh.surface.triangles;
    for (std::size_t t = 0; t < triangles.size(); ++t) {
        const Vec3f a = seen_[triangles[t][0]], b = seen_[triangles[t][1]], c = seen_[triangles[t][2]];
        if (!(a.z > kNear_m && b.z > kNear_m && c.z > kNear_m)) continue;
        for_cells_in_triangle(a.x, a.y, b.x, b.y, c.x, c.y, box_, [&](int x, int y, float b1, float b2) {
            const std::size_t at = static_cast<std::size_t>(y) * camera.width + x;
            const float depth = a.z + b1 * (b.z - a.z) + b2 * (c.z - a.z);
            if (!(depth < depth_[at])) return;
            depth_[at] = depth;
            out[at] = labels[t];
        });
    }
}

}  // namespace kinevox::studio
