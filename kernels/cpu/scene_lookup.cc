#include "kernels/cpu/scene_lookup.h"

#include <algorithm>

#include "kernels/cpu/simd.h"

#ifdef KINEVOX_HAVE_AVX2_FORM
#include <immintrin.h>
#endif

namespace kinevox::kernels::cpu {
namespace {

template <int kChannels>
void lights_plain(const kde::SceneView& view, const FloorPoints& points,
                  const kde::EvidenceParameters& parameters, float* light) {
    for (int n = 0; n < kPointsPerLookup; ++n)
        light[n] = kde::light_of_floor<kChannels>(view, points.x[n], points.y[n], parameters);
}

float support_plain(const kde::SupportRay& ray, std::span<const kde::SceneView* const> views) {
    return kde::support_of(ray, static_cast<int>(views.size()),
                           [&](int n) -> const kde::SceneView& { return *views[n]; });
}

#ifdef KINEVOX_HAVE_AVX2_FORM
static_assert(kPointsPerLookup == kLanes && kde::kSupportSamples == 2 * kLanes);

#define KINEVOX_LOOKUP KINEVOX_AVX2_EXACT inline __attribute__((always_inline))

struct Indices {
    Ints column, row;
    Ints seen;  // -1 where the camera looks that way, else 0
};

// to_index()
KINEVOX_LOOKUP Ints index_of(Floats u) {
    const Floats low = splat(-30000.f), high = splat(30000.f);
    u = u < low ? low : u > high ? high : u;
    return to_ints(u + 32768.5f) - 32768;
}

// to_camera(), to_pixel() and to_index() in their order of operations: the same bits.
KINEVOX_LOOKUP Indices pixels_of(const Projector& c, const Floats& px, const Floats& py, const Floats& pz) {
    const Floats cx = c.r[0] * px + c.r[1] * py + c.r[2] * pz + c.t[0];
    const Floats cy = c.r[3] * px + c.r[4] * py + c.r[5] * pz + c.t[1];
    const Floats cz = c.r[6] * px + c.r[7] * py + c.r[8] * pz + c.t[2];
    const Floats w = 1.f / cz;
    Floats x = cx * w, y = cy * w;
    const Floats r2 = x * x + y * y;
    Indices out;
    out.seen = (cz > kNearest_m) & (r2 < c.max_radius2);
    if (c.distorted) {
        const Floats radial = 1.f + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
        const Floats xd = x * radial + 2 * c.p1 * x * y + c.p2 * (r2 + 2.f * x * x);
        const Floats yd = y * radial + c.p1 * (r2 + 2.f * y * y) + 2 * c.p2 * x * y;
        x = xd;
        y = yd;
    }
    out.column = index_of(c.fx * x + c.cx);
    out.row = index_of(c.fy * y + c.cy);
    return out;
}

KINEVOX_LOOKUP Ints gather(const void* bytes, const Ints& offset) {
    return reinterpret_cast<Ints>(
        _mm256_i32gather_epi32(static_cast<const int*>(bytes), reinterpret_cast<__m256i>(offset), 1));
}

// Bytes at offsets whose aligned words belong to the same array.
struct ByteOffsets {
    Ints word, shift;
};
KINEVOX_LOOKUP ByteOffsets byte_offsets(const Ints& offset) {
    return {offset & ~3, (offset & 3) << 3};
}
KINEVOX_LOOKUP Floats levels(const std::uint8_t* bytes, const ByteOffsets& at) {
    return to_floats(gather(bytes, at.word) >> at.shift & 255);
}

KINEVOX_AVX2_EXACT void lights_avx2(const kde::SceneView& view, const FloorPoints& points,
                                    const kde::EvidenceParameters& p, float* light) {
    constexpr int kChannels = 3, kPlane = kde::kCellPixels;
    Floats x, y;
    std::memcpy(&x, points.x, sizeof x);
    std::memcpy(&y, points.y, sizeof y);
    const Indices at = pixels_of(view.camera, x, y, Floats{});
    const Ints valid = at.seen & (at.column >= 1) & (at.row >= 1) & (at.column < view.camera.width - 1) &
                       (at.row < view.camera.height - 1);
    Floats out = splat(-1);
    if (_mm256_movemask_ps(reinterpret_cast<__m256>(valid)) != 0) {
        const Ints column = valid ? at.column : Ints{} + 1, row = valid ? at.row : Ints{} + 1;
        const auto stride = static_cast<int>(view.image_stride);
        const auto cell_offset = [&](const Ints& px, const Ints& py) KINEVOX_AVX2_EXACT {
            return (py * view.cells_per_row + (px >> 6)) * (kChannels * kPlane) + (px & (kPlane - 1));
        };
        static_assert(kPlane == 64);
        Floats product{}, energy{}, residual{}, scales{}, variances{};
        constexpr int kCross[5][2] = {{0, 0}, {-1, 0}, {1, 0}, {0, -1}, {0, 1}};
        for (const auto& step : kCross) {
            const Ints px = column + step[0], py = row + step[1];
            // A pixel is inside the image by a row or a column, so four bytes from it are, too.
            const Ints pixel = gather(view.image, py * stride + px * kChannels);
            const ByteOffsets reference = byte_offsets(cell_offset(px, py));
            Floats pixel_product{}, pixel_energy = splat(1), square{};
            for (int c = 0; c < kChannels; ++c) {
                const Floats r = levels(view.reference + c * kPlane, reference);
                const Floats value =
                    to_floats((pixel >> (8 * c) & 255) * view.inverse_gain[c]) * (1.0f / 16384.0f);
                pixel_product += value * r;
                pixel_energy += r * r;
                square += value * value;
            }
            residual += square - pixel_product * pixel_product / pixel_energy;
            product += pixel_product;
            energy += pixel_energy;
        }
        const ByteOffsets centre = byte_offsets(cell_offset(column, row));
        for (int c = 0; c < kChannels; ++c) {
            const Floats r = levels(view.reference + c * kPlane, centre),
                         s = levels(view.scale + c * kPlane, centre);
            const Floats spread = p.relative_std * r;
            scales += s * s;
            variances += p.noise_fraction * 65536.0f + spread * spread * (s * s);
        }
        const Floats found = product / energy;
        const Ints known = valid & ~((residual * scales > 5 * kde::kMaxFloorResidual * variances) |
                                     (found > kde::kMaxFloorLight));
        out = known ? found : out;
    }
    std::memcpy(light, &out, sizeof out);
}

// Of kLanes samples of the ray from `first` on, the highest votes as kde::votes_on_sample().
KINEVOX_LOOKUP int best_votes(const kde::SupportRay& ray, float first,
                              std::span<const kde::SceneView* const> views) {
    const int count = static_cast<int>(views.size()), max_against = (count + 1) / 3;
    const float step = (ray.far - ray.near) * (1.0f / kde::kSupportSamples);
    const Floats number = Floats{0, 1, 2, 3, 4, 5, 6, 7} + first;
    const Floats t = ray.near + (number + 0.5f) * step;
    const Floats x = ray.origin[0] + t * ray.direction[0], y = ray.origin[1] + t * ray.direction[1],
                 z = ray.origin[2] + t * ray.direction[2];
    Ints sum{}, against{};
    for (const kde::SceneView* const view : views) {
        const Indices at = pixels_of(view->camera, x, y, z);
        const Ints valid = at.seen & (at.column >= 0) & (at.row >= 0) & (at.column < view->camera.width) &
                           (at.row < view->camera.height);
        const Ints block = valid & ((at.row >> 2) * view->vote_columns + (at.column >> 2));
        static_assert(kde::kVoteBlock_px == 4);
        const Ints vote = gather(view->votes, block) << 24 >> 24;
        sum += vote & valid;
        against -= valid & (vote <= -kde::kMaxVote + 1);
    }
    const Ints none = Ints{} - kde::kMaxVote * count - 1;
    const Ints kept = against > max_against ? none : sum;
    int best = kept[0];
    for (int lane = 1; lane < kLanes; ++lane) best = std::max(best, kept[lane]);
    return best;
}

KINEVOX_AVX2_EXACT float support_avx2(kde::SupportRay ray, std::span<const kde::SceneView* const> views) {
    const int count = static_cast<int>(views.size());
    if (!kde::confine_to_views(ray, count, [&](int n) -> const kde::SceneView& { return *views[n]; }))
        return kde::kUnknownSupport;
    if (!(ray.near < ray.far)) return kde::kNoSupport;
    const int best = std::max(best_votes(ray, 0, views), best_votes(ray, kLanes, views));
    return kde::support_of_votes(best, count);
}
#endif

}  // namespace

void lights_of_floor(const kde::SceneView& view, const FloorPoints& points,
                     const kde::EvidenceParameters& parameters, float light[kPointsPerLookup]) {
    if (view.channels == 1) return lights_plain<1>(view, points, parameters, light);
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) return lights_avx2(view, points, parameters, light);
#endif
    lights_plain<3>(view, points, parameters, light);
}

float support_of(const kde::SupportRay& ray, std::span<const kde::SceneView* const> views) {
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) return support_avx2(ray, views);
#endif
    return support_plain(ray, views);
}

}  // namespace kinevox::kernels::cpu
