#include "server/cameras/studio/shadow.h"

#include <limits>

namespace kinevox::studio {
namespace {

constexpr float kLayerTops_m[2] = {0.28f, 0.85f};
constexpr float kLayerHeights_m[3] = {0.10f, 0.55f, 1.30f};  // at which a layer's softness is taken

}  // namespace

void FloorShadow::Layer::clear() {
    if (cover.empty()) cover.assign(static_cast<std::size_t>(kCells) * kCells, 0.0f);
    for (int y = box.y0; y < box.y1; ++y)
        std::fill_n(&cover[static_cast<std::size_t>(y) * kCells + box.x0], box.x1 - box.x0, 0.0f);
    box = {kCells, kCells, 0, 0};
}

void FloorShadow::Layer::mark(int x, int y, float value) {
    float& here = cover[static_cast<std::size_t>(y) * kCells + x];
    here = std::max(here, value);
    box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x + 1), std::max(box.y1, y + 1)};
}

// Two box filters along each axis, inside the layer's box enlarged by their radius.
void FloorShadow::Layer::blur(int radius, std::vector<float>& scratch) {
    if (box.empty() || radius < 1) return;
    const int grow = 2 * radius;
    box = {std::max(0, box.x0 - grow), std::max(0, box.y0 - grow), std::min(kCells, box.x1 + grow),
           std::min(kCells, box.y1 + grow)};
    const int wide = box.x1 - box.x0, high = box.y1 - box.y0;
    const float share = 1.0f / static_cast<float>(2 * radius + 1);
    scratch.resize(static_cast<std::size_t>(kCells) * kCells);
    for (int round = 0; round < 2; ++round) {
        for (int y = 0; y < high; ++y) {  // along x into scratch
            const float* in = &cover[static_cast<std::size_t>(box.y0 + y) * kCells + box.x0];
            float* out = &scratch[static_cast<std::size_t>(y) * wide];
            float sum = 0;
            for (int x = 0; x < std::min(radius, wide); ++x) sum += in[x];
            for (int x = 0; x < wide; ++x) {
                if (x + radius < wide) sum += in[x + radius];
                if (x - radius - 1 >= 0) sum -= in[x - radius - 1];
                out[x] = sum * share;
            }
        }
        // Along y back, a row of running sums at a time.
        float sums[kCells] = {};
        for (int y = 0; y < std::min(radius, high); ++y)
            for (int x = 0; x < wide; ++x) sums[x] += scratch[static_cast<std::size_t>(y) * wide + x];
        for (int y = 0; y < high; ++y) {
            float* out = &cover[static_cast<std::size_t>(box.y0 + y) * kCells + box.x0];
            if (y + radius < high)
                for (int x = 0; x < wide; ++x)
                    sums[x] += scratch[static_cast<std::size_t>(y + radius) * wide + x];
            if (y - radius - 1 >= 0)
                for (int x = 0; x < wide; ++x)
                    sums[x] -= scratch[static_cast<std::size_t>(y - radius - 1) * wide + x];
            for (int x = 0; x < wide; ++x) out[x] = sums[x] * share;
        }
    }
}

void FloorShadow::cast(const TriangleMesh& surface, const std::vector<Vec3f>& vertices,
                       const Lighting& lighting) {
    const Vec3f lamp = lighting.key.position;
    Vec3f centre;
    for (const Vec3f& v : vertices) centre += v;
    centre = (1.0f / static_cast<float>(vertices.size())) * centre;
    // Midway between the body and the far end of its shadow, in whole cells of the world.
    const float stretch = 1.0f + 0.5f * 1.7f / std::max(lamp.z - 1.7f, 0.5f);
    const float middle_x = lamp.x + stretch * (centre.x - lamp.x),
                middle_y = lamp.y + stretch * (centre.y - lamp.y);
    origin_x_ = (std::round(middle_x / kCell_m) - 0.5f * kCells) * kCell_m;
    origin_y_ = (std::round(middle_y / kCell_m) - 0.5f * kCells) * kCell_m;
    factor_.resize(static_cast<std::size_t>(kCells) * kCells);
    for (Layer& layer : layers_) layer.clear();

    const CellBounds all{0, 0, kCells, kCells};
    const auto to_cells = [&](Vec3f p, float& x, float& y) {
        x = (p.x - origin_x_) / kCell_m;
        y = (p.y - origin_y_) / kCell_m;
    };
    const auto from_lamp = [&](Vec3f p) {
        const float s = lamp.z / std::max(lamp.z - p.z, 0.2f);
        return lamp + s * (p - lamp);
    };
    for (const auto& t : surface.triangles) {
        const Vec3f a = vertices[t[0]], b = vertices[t[1]], c = vertices[t[2]];
        const float height = (a.z + b.z + c.z) / 3;
        float ax, ay, bx, by, cx, cy;
        if (dot(cross(b - a, c - a), lamp - a) > 0) {  // one side of the surface is enough
            Layer& layer = layers_[height < kLayerTops_m[0] ? 0 : height < kLayerTops_m[1] ? 1 : 2];
            to_cells(from_lamp(a), ax, ay);
            to_cells(from_lamp(b), bx, by);
            to_cells(from_lamp(c), cx, cy);
            for_cells_in_triangle(ax, ay, bx, by, cx, cy, all,
                                  [&](int x, int y, float, float) { layer.mark(x, y, 1.0f); });
        }
        if (height < 0.7f && cross(b - a, c - a).z < 0) {
            to_cells(a, ax, ay);
            to_cells(b, bx, by);
            to_cells(c, cx, cy);
            const float value = std::exp(-std::max(height, 0.0f) / 0.16f);
            for_cells_in_triangle(ax, ay, bx, by, cx, cy, all,
                                  [&](int x, int y, float, float) { layers_[3].mark(x, y, value); });
        }
    }
    for (int i = 0; i < 3; ++i) {
        const float soft =
            lighting.key.half_size_m * kLayerHeights_m[i] / std::max(lamp.z - kLayerHeights_m[i], 0.3f);
        layers_[i].blur(std::max(1, static_cast<int>(soft / kCell_m + 0.5f)), scratch_);
    }
    layers_[3].blur(1, scratch_);

    dark_ = {kCells, kCells, 0, 0};
    for (const Layer& l : layers_)
        if (!l.box.empty())
            dark_ = {std::min(dark_.x0, l.box.x0), std::min(dark_.y0, l.box.y0), std::max(dark_.x1, l.box.x1),
                     std::max(dark_.y1, l.box.y1)};
    if (dark_.empty()) return;
    // A rim of ones, so that interpolation ends smoothly.
    dark_ = {std::max(0, dark_.x0 - 1), std::max(0, dark_.y0 - 1), std::min(kCells, dark_.x1 + 1),
             std::min(kCells, dark_.y1 + 1)};
    for (int y = dark_.y0; y < dark_.y1; ++y)
        for (int x = dark_.x0; x < dark_.x1; ++x) {
            const std::size_t i = static_cast<std::size_t>(y) * kCells + x;
            const float open =
                (1 - layers_[0].cover[i]) * (1 - layers_[1].cover[i]) * (1 - layers_[2].cover[i]);
            const float under = layers_[3].cover[i];
            if (open > 0.999f && under < 0.001f) {
                factor_[i] = 1;
                continue;
            }
            const Vec3f p{origin_x_ + x * kCell_m, origin_y_ + y * kCell_m, 0}, up{0, 0, 1};
            const float key = Lighting::direct(lighting.key, p, up).y;
            float fill = lighting.from_above.y;
            for (const Lamp& lamp_above : lighting.panels) fill += Lighting::direct(lamp_above, p, up).y;
            factor_[i] = std::pow((key * open + fill * (1 - 0.9f * under)) / (key + fill), 1 / 2.2f);
        }
}

void FloorShadow::extent(float& x0, float& y0, float& x1, float& y1) const {
    x0 = origin_x_ + dark_.x0 * kCell_m;
    y0 = origin_y_ + dark_.y0 * kCell_m;
    x1 = origin_x_ + dark_.x1 * kCell_m;
    y1 = origin_y_ + dark_.y1 * kCell_m;
}

Vec3f BodyShadow::seen_from_lamp(Vec3f p) const {
    const Vec3f q = p - lamp_;
    const float z = std::max(dot(q, axis_), 0.1f), inv = scale_ / z;
    return {dot(q, right_) * inv + shift_x_, dot(q, up_) * inv + shift_y_, z};
}

void BodyShadow::cast(const TriangleMesh& surface, const std::vector<Vec3f>& vertices, Vec3f lamp) {
    Vec3f centre;
    for (const Vec3f& v : vertices) centre += v;
    centre = (1.0f / static_cast<float>(vertices.size())) * centre;
    lamp_ = lamp;
    axis_ = normalized(centre - lamp);
    right_ = normalized(cross(axis_, std::abs(axis_.z) < 0.95f ? Vec3f{0, 0, 1} : Vec3f{1, 0, 0}));
    up_ = cross(right_, axis_);
    scale_ = 1;
    shift_x_ = shift_y_ = 0;
    float x0 = 1e9f, y0 = 1e9f, x1 = -1e9f, y1 = -1e9f;
    seen_.resize(vertices.size());
    for (std::size_t i = 0; i < vertices.size(); ++i) {
        seen_[i] = seen_from_lamp(vertices[i]);
        x0 = std::min(x0, seen_[i].x);
        x1 = std::max(x1, seen_[i].x);
        y0 = std::min(y0, seen_[i].y);
        y1 = std::max(y1, seen_[i].y);
    }
    scale_ = (kCells - 4) / std::max({x1 - x0, y1 - y0, 1e-3f});
    shift_x_ = 2 - scale_ * x0;
    shift_y_ = 2 - scale_ * y0;
    for (Vec3f& s : seen_) s = {scale_ * s.x + shift_x_, scale_ * s.y + shift_y_, s.z};
    depth_.assign(static_cast<std::size_t>(kCells) * kCells, std::numeric_limits<float>::infinity());
    for (const auto& t : surface.triangles) {
        const Vec3f a = seen_[t[0]], b = seen_[t[1]], c = seen_[t[2]];
        for_cells_in_triangle(a.x, a.y, b.x, b.y, c.x, c.y, {0, 0, kCells, kCells},
                              [&](int x, int y, float b1, float b2) {
                                  float& depth = depth_[static_cast<std::size_t>(y) * kCells + x];
                                  depth = std::min(depth, a.z + b1 * (b.z - a.z) + b2 * (c.z - a.z));
                              });
    }
}

float BodyShadow::lit(Vec3f p) const {
    constexpr float kBias_m = 0.05f;
    const Vec3f s = seen_from_lamp(p);
    const int i = static_cast<int>(s.x), j = static_cast<int>(s.y);
    if (s.x < 0 || s.y < 0 || i + 1 >= kCells || j + 1 >= kCells) return 1;
    const float fx = s.x - i, fy = s.y - j, limit = s.z - kBias_m;
    const float* row = &depth_[static_cast<std::size_t>(j) * kCells + i];
    const auto open = [&](float depth) { return depth >= limit ? 1.0f : 0.0f; };
    return (1 - fy) * ((1 - fx) * open(row[0]) + fx * open(row[1])) +
           fy * ((1 - fx) * open(row[kCells]) + fx * open(row[kCells + 1]));
}

}  // namespace kinevox::studio
