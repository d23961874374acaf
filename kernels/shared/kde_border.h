// Sub-pixel correction of the silhouette's border. Border pixels mix subject and background; since noise is
// small compared to the contrast, 10 % of the subject already counts as foreground and silhouettes are half a
// pixel to a pixel too wide. So each pixel near the border is unmixed between the nearby colour of the
// subject and the background, and belongs to the sharp silhouette if at least half of it is the subject.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>

#include "kernels/shared/device.h"
#include "kernels/shared/kde_density.h"
#include "kernels/types.h"

namespace kinevox::kernels::kde {

inline constexpr int kBorderRadius = 3;  // px around a border pixel where subject and light are sampled
inline constexpr int kBorderDepth = 2;   // px inside and outside the border that are reclassified

struct BorderParameters {
    float min_contrast = 400;  // minimum squared distance of subject and background for a decision
    float subject_fraction = 0.5f;
};

inline constexpr std::uint8_t kZoneBorder = 0, kZoneInside = 1, kZoneOutside = 2;

// Of a pixel `dx`, `dy` beside the one that is decided: 1 / (1 + its squared distance) in parts of
// kWeightOne. Whole numbers, so that no order of summing changes a sum.
inline constexpr int kWeightOne = 120;
KINEVOX_HD constexpr int border_weight(int dx, int dy) {
    const int from_one = 1 + dx * dx + dy * dy;
    return (kWeightOne + from_one / 2) / from_one;
}

// What the pixels around a border pixel sum up to, weighted: the subject's colours, and for the light the
// products of value and reference and the references' squares, over all channels.
template <int kChannels>
struct BorderSums {
    int subject[kChannels] = {}, subject_weight = 0;
    int product = 0, energy = 0;
};

// Calls body(x, zone) for every second pixel of [first, end), at most eight pixels, that is not border.
template <class F>
KINEVOX_HD inline void for_each_certain(const std::uint8_t* zones, int first, int end, F body) {
#ifndef __CUDA_ARCH__
    // Most of a window is border; finds the other pixels as bits.
    if (std::endian::native == std::endian::little && end - first > 4) {
        std::uint32_t low, high;
        std::memcpy(&low, zones + first, 4);
        std::memcpy(&high, zones + end - 4, 4);
        const std::uint64_t window = low | std::uint64_t{high} << 8 * (end - 4 - first);
        for (std::uint64_t certain = window & 0x00ff00ff00ff00ffu; certain != 0; certain &= certain - 1) {
            const int byte = std::countr_zero(certain) / 8;
            body(first + byte, static_cast<std::uint8_t>(window >> 8 * byte));
        }
        return;
    }
#endif
    for (int x = first; x < end; x += 2)
        if (zones[x] != kZoneBorder) body(x, zones[x]);
}

// Where the values of pixel (x, y) lie in arrays of cells, `cells_per_row` to a row.
template <int kChannels>
KINEVOX_HD inline long long border_offset(int x, int y, int cells_per_row) {
    return (static_cast<long long>(y) * cells_per_row + x / kCellPixels) * (kChannels * kCellPixels) +
           x % kCellPixels;
}

// Adds the pixels of row `py` of the window around (x, y). `zones` has `width` bytes a row; only pixels
// inside `limit` are read.
template <int kChannels>
KINEVOX_HD KINEVOX_INLINE void add_row_around(int x, int y, int py, int width, const Rect& limit,
                                              const std::uint8_t* zones, const std::uint8_t* values,
                                              const std::uint8_t* reference, int cells_per_row,
                                              BorderSums<kChannels>& sums) {
    if (py < limit.y0 || py >= limit.y1) return;
    const int x0 = x - kBorderRadius < limit.x0 ? limit.x0 : x - kBorderRadius;
    const int x1 = x + kBorderRadius + 1 > limit.x1 ? limit.x1 : x + kBorderRadius + 1;
    const std::uint8_t* row = zones + static_cast<long long>(py) * width;
    // A chessboard pattern gives the same result at half the cost.
    for_each_certain(row, x0 + ((x0 + py) & 1), x1, [&](int px, std::uint8_t zone) {
        const long long at = border_offset<kChannels>(px, py, cells_per_row);
        const std::uint8_t* v = values + at;
        const int weight = border_weight(px - x, py - y);
        if (zone == kZoneInside) {
            for (int c = 0; c < kChannels; ++c) sums.subject[c] += weight * v[c * kCellPixels];
            sums.subject_weight += weight;
        } else {
            const std::uint8_t* r = reference + at;
            for (int c = 0; c < kChannels; ++c) {
                const int level = r[c * kCellPixels];
                sums.product += weight * level * v[c * kCellPixels];
                sums.energy += weight * level * level;
            }
        }
    });
}

template <int kChannels>
KINEVOX_HD inline BorderSums<kChannels> sum_around(int x, int y, int width, const Rect& limit,
                                                   const std::uint8_t* zones, const std::uint8_t* values,
                                                   const std::uint8_t* reference, int cells_per_row) {
    BorderSums<kChannels> sums;
    for (int py = y - kBorderRadius; py <= y + kBorderRadius; ++py)
        add_row_around<kChannels>(x, y, py, width, limit, zones, values, reference, cells_per_row, sums);
    return sums;
}

// 1 if at least half of the pixel is the subject, 0 if not, -1 if undecidable.
template <int kChannels>
KINEVOX_HD inline int unmix(const BorderSums<kChannels>& sums, const std::uint8_t* value,
                            const std::uint8_t* reference, const BorderParameters& p) {
    if (sums.subject_weight <= 0) return -1;
    const auto weight = static_cast<float>(sums.subject_weight);
    float light = sums.energy > 0 ? static_cast<float>(sums.product) / static_cast<float>(sums.energy) : 1.0f;
    light = light < 0.3f ? 0.3f : light > 1.3f ? 1.3f : light;
    float along = 0, contrast = 0;
    for (int c = 0; c < kChannels; ++c) {
        const float background = light * reference[c * kCellPixels];
        const float step = static_cast<float>(sums.subject[c]) / weight - background;
        along += (value[c * kCellPixels] - background) * step;
        contrast += step * step;
    }
    if (contrast < p.min_contrast) return -1;
    return along > p.subject_fraction * contrast ? 1 : 0;
}

// unmix() of the pixel (x, y); `values` and `reference` in cells.
template <int kChannels>
KINEVOX_HD inline int unmix_border_pixel(int x, int y, int width, const Rect& limit,
                                         const std::uint8_t* zones, const std::uint8_t* values,
                                         const std::uint8_t* reference, int cells_per_row,
                                         const BorderParameters& p) {
    const long long at = border_offset<kChannels>(x, y, cells_per_row);
    return unmix<kChannels>(
        sum_around<kChannels>(x, y, width, limit, zones, values, reference, cells_per_row), values + at,
        reference + at, p);
}

}  // namespace kinevox::kernels::kde
