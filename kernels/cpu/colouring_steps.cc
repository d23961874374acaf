#include "kernels/cpu/colouring_steps.h"

#include <algorithm>
#include <limits>
#include <vector>

#include "kernels/cpu/sixteen_lanes.h"
#include "kernels/shared/colouring.h"

namespace kinevox::kernels {
namespace {

constexpr float kHalf = 0.5f;  // of a grey level, before it is cut off

void paint_plain(std::span<const CellColours> colours, std::span<const ViewOfVolume> of_volume,
                 const Surface& surface, int first, int last, Colour* out) {
    for (int n = first; n < last; ++n) {
        const unsigned open = surface.open[n];
        float sum[3] = {}, weights = 0;
        for (std::size_t v = 0; v < of_volume.size(); ++v) {
            const ViewOfVolume& view = of_volume[v];
            const int cell = view.cell[n];
            if (cell < 0 || colours[v].means.empty()) continue;
            float weight = colour_weight(view.facing[open], view.depth_m[n]);
            if (!sees(view, n, open)) weight *= kHiddenWeight;
            const std::uint8_t* mean = colours[v].means.data() + 3 * mean_index(cell, view.cells.width());
            for (int c = 0; c < 3; ++c) sum[c] += weight * static_cast<float>(mean[c]);
            weights += weight;
        }
        Colour colour;
        if (weights > 0) {
            const auto value = [&](int c) { return static_cast<std::uint8_t>(sum[c] / weights + kHalf); };
            colour = {value(2), value(1), value(0)};
        }
        out[n] = colour;
    }
}

#ifdef KINEVOX_HAVE_AVX2_FORM
// Sixteen voxels' sums over the views.
struct Paint {
    __m512 sum[3];  // B, G, R
    __m512 weights;
};

// Adds a view's colours of the surface voxels n .. n + 15 that are in `here`.
KINEVOX_AVX512 void add_view(const CellColours& colours, const ViewOfVolume& view, int n, __mmask16 here,
                             __m512i open, Paint& paint) {
    const __m512i cell = _mm512_maskz_loadu_epi32(here, &view.cell[n]);
    const __mmask16 in_image = _mm512_mask_cmpge_epi32_mask(here, cell, _mm512_setzero_si512());
    const __m512 depth = _mm512_mask_loadu_ps(sixteen::all(1.f), here, &view.depth_m[n]);
    // colour_weight() and sees()
    __m512 weight = _mm512_max_ps(sixteen::look_up(view.facing.data(), open), sixteen::all(0.05f));
    weight = _mm512_mul_ps(weight, _mm512_div_ps(weight, _mm512_mul_ps(depth, depth)));
    const __m512 front =
        _mm512_mask_i32gather_ps(_mm512_setzero_ps(), in_image, cell, view.depths.data(), sizeof(DepthCell));
    const __m512 behind = sixteen::look_up(view.behind_m.data(), open);
    const __mmask16 hidden =
        _mm512_mask_cmp_ps_mask(in_image, depth, _mm512_add_ps(front, behind), _CMP_GT_OQ);
    weight = _mm512_mask_mul_ps(weight, hidden, weight, sixteen::all(kHiddenWeight));
    // mean_index(); the quotient of floats is at most one off.
    const __m512i columns = sixteen::all(view.cells.width());
    __m512i row = _mm512_cvttps_epi32(_mm512_div_ps(_mm512_cvtepi32_ps(cell), _mm512_cvtepi32_ps(columns)));
    const __m512i rest = _mm512_sub_epi32(cell, _mm512_mullo_epi32(row, columns));
    row = _mm512_mask_add_epi32(row, _mm512_cmpge_epi32_mask(rest, columns), row, sixteen::all(1));
    row = _mm512_mask_sub_epi32(row, _mm512_cmplt_epi32_mask(rest, _mm512_setzero_si512()), row,
                                sixteen::all(1));
    const __m512i index = _mm512_add_epi32(_mm512_add_epi32(cell, _mm512_add_epi32(row, row)),
                                           _mm512_add_epi32(columns, sixteen::all(3)));
    // Reads one byte beyond each mean, which the rim of cells allows.
    const __m512i mean =
        _mm512_mask_i32gather_epi32(_mm512_setzero_si512(), in_image,
                                    _mm512_mullo_epi32(index, sixteen::all(3)), colours.means.data(), 1);
    for (int c = 0; c < 3; ++c) {
        const __m512i value =
            _mm512_and_si512(_mm512_srlv_epi32(mean, sixteen::all(8 * c)), sixteen::all(255));
        paint.sum[c] = _mm512_mask_add_ps(paint.sum[c], in_image, paint.sum[c],
                                          _mm512_mul_ps(weight, _mm512_cvtepi32_ps(value)));
    }
    paint.weights = _mm512_mask_add_ps(paint.weights, in_image, paint.weights, weight);
}

KINEVOX_AVX512 void paint_avx512(std::span<const CellColours> colours,
                                 std::span<const ViewOfVolume> of_volume, const Surface& surface, int first,
                                 int last, Colour* out) {
    for (int n = first; n < last; n += 16) {
        const int count = std::min(last - n, 16);
        const auto here = static_cast<__mmask16>((1u << count) - 1);
        const __m512i open = _mm512_cvtepu8_epi32(_mm_maskz_loadu_epi8(here, &surface.open[n]));
        Paint paint{};
        for (std::size_t v = 0; v < of_volume.size(); ++v)
            if (!colours[v].means.empty()) add_view(colours[v], of_volume[v], n, here, open, paint);
        const __mmask16 seen = _mm512_cmp_ps_mask(paint.weights, _mm512_setzero_ps(), _CMP_GT_OQ);
        alignas(64) std::int32_t values[3][16];
        for (int c = 0; c < 3; ++c) {
            const __m512 value =
                _mm512_add_ps(_mm512_maskz_div_ps(seen, paint.sum[c], paint.weights), sixteen::all(kHalf));
            _mm512_store_si512(values[c], _mm512_maskz_cvttps_epi32(seen, value));
        }
        for (int i = 0; i < count; ++i)
            out[n + i] = {static_cast<std::uint8_t>(values[2][i]), static_cast<std::uint8_t>(values[1][i]),
                          static_cast<std::uint8_t>(values[0][i])};
    }
}
#endif

}  // namespace

Rect bounds_of(const std::uint8_t* mask, int width, int height) {
    Rect box{width, height, 0, 0};
    for (int y = 0; y < height; ++y) {
        const std::uint8_t* row = mask + static_cast<std::size_t>(y) * width;
        const std::uint8_t* const end = row + width;
        const std::uint8_t* first = std::find_if(row, end, [](std::uint8_t value) { return value != 0; });
        if (first == end) continue;
        int last = width - 1;
        while (row[last] == 0) --last;
        box.x0 = std::min(box.x0, static_cast<int>(first - row));
        box.x1 = std::max(box.x1, last + 1);
        box.y0 = std::min(box.y0, y);
        box.y1 = y + 1;
    }
    return box.x1 > box.x0 ? box : Rect{};
}

float silhouette_iou(const ColouringView& view, const ViewOfVolume& of_volume) {
    constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
    const std::uint8_t* const mask = view.sharp ? view.sharp : view.silhouette;
    if (!mask) return kNothing;
    const int width = of_volume.camera.width, height = of_volume.camera.height;
    const int columns = of_volume.cells.width(), rows = of_volume.cells.height(), shift = of_volume.shift;
    const int radius = of_volume.radius;
    std::int64_t both = 0, silhouette = 0, projection = 0;
    Rect box = view.bounds.empty() ? Rect{0, 0, width, height} : view.bounds;
    for (int y = std::max(box.y0, 0); y < std::min(box.y1, height); ++y) {
        const std::uint8_t* row = mask + static_cast<std::size_t>(y) * width;
        int here = 0;
        for (int x = std::max(box.x0, 0); x < std::min(box.x1, width); ++x) here += row[x] != 0;
        silhouette += here;
    }
    // The splats widened the projection by `radius` cells; eroding it again closes the surface's pinholes
    // without enlarging it.
    std::vector<std::uint8_t> worst(columns), narrow(columns),
        wide(static_cast<std::size_t>(columns) << shift);
    for (int cy = 0; cy < rows; ++cy) {
        if (of_volume.spans[cy].first >= of_volume.spans[cy].last) continue;
        std::fill(worst.begin(), worst.end(), std::uint8_t{1});
        for (int from = std::max(cy - radius, 0); from <= std::min(cy + radius, rows - 1); ++from) {
            const DepthCell* depths = of_volume.depths.data() + static_cast<std::size_t>(from) * columns;
            for (int x = 0; x < columns; ++x) worst[x] &= !depths[x].empty();
        }
        std::copy(worst.begin(), worst.end(), narrow.begin());
        for (int step = 1; step <= radius && step < columns; ++step) {
            for (int x = 0; x < columns - step; ++x) narrow[x] &= worst[x + step];
            for (int x = step; x < columns; ++x) narrow[x] &= worst[x - step];
        }
        const int y0 = (cy + of_volume.cells.y0) << shift, x0 = of_volume.cells.x0 << shift;
        const int end = std::min(columns << shift, width - x0);
        for (int x = 0; x < end; ++x) wide[x] = narrow[x >> shift];
        int covered = 0;
        for (int x = 0; x < end; ++x) covered += wide[x];
        if (covered == 0) continue;
        for (int y = y0; y < std::min(y0 + (1 << shift), height); ++y) {
            const std::uint8_t* row = mask + static_cast<std::size_t>(y) * width + x0;
            int shared = 0;
            for (int x = 0; x < end; ++x) shared += wide[x] & (row[x] != 0);
            projection += covered;
            both += shared;
        }
    }
    const std::int64_t either = silhouette + projection - both;
    return either > 0 ? static_cast<float>(both) / static_cast<float>(either) : kNothing;
}

void paint_brick(std::span<const CellColours> colours, std::span<const ViewOfVolume> of_volume,
                 const Surface& surface, int brick, VoxelVolume& volume) {
    const int first = surface.first[brick], last = surface.first[brick + 1];
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx512()) return paint_avx512(colours, of_volume, surface, first, last, volume.colours.data());
#endif
    paint_plain(colours, of_volume, surface, first, last, volume.colours.data());
}

}  // namespace kinevox::kernels
