// Where exactly the silhouette ends. A pixel on the border mixes subject and background, and noise is so
// small against the subject's contrast that a tenth of the subject already counts as foreground: silhouettes
// come out half a pixel to a pixel fat. So each pixel near the border is unmixed between the subject's colour
// a little further in and the background, and belongs to the sharp silhouette if half or more of it is the
// subject.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>

#include "kernels/shared/device.h"
#include "kernels/shared/kde_density.h"
#include "kernels/types.h"

namespace kinevox::kernels::kde {

inline constexpr int kBorderReach = 3;  // px around a border pixel where subject and light are sampled
inline constexpr int kBorderDepth = 2;  // px from the border inwards and outwards that are decided anew

struct BorderParameters {
    float min_contrast = 400;  // squared distance of subject and background below which nothing can be said
    float subject_part = 0.5f;
};

inline constexpr std::uint8_t kZoneBorder = 0, kZoneInside = 1, kZoneOutside = 2;

KINEVOX_HD inline float border_weight(int dx, int dy) {
#ifndef __CUDA_ARCH__
    static constexpr auto kWeights = [] {
        std::array<float, 2 * kBorderReach * kBorderReach + 1> weights{};
        for (int i = 0; i < static_cast<int>(weights.size()); ++i)
            weights[i] = 1.0f / static_cast<float>(1 + i);
        return weights;
    }();
    return kWeights[dx * dx + dy * dy];
#else
    return 1.0f / static_cast<float>(1 + dx * dx + dy * dy);
#endif
}

// Calls body(x, zone) for every second pixel of [first, end), at most eight pixels, that is not border.
template <class F>
KINEVOX_HD inline void for_each_told(const std::uint8_t* zones, int first, int end, F body) {
#ifndef __CUDA_ARCH__
    // Most of a window is border; what is not comes at once as bits.
    if (std::endian::native == std::endian::little && end - first > 4) {
        std::uint32_t low, high;
        std::memcpy(&low, zones + first, 4);
        std::memcpy(&high, zones + end - 4, 4);
        const std::uint64_t window = low | std::uint64_t{high} << 8 * (end - 4 - first);
        for (std::uint64_t told = window & 0x00ff00ff00ff00ffu; told != 0; told &= told - 1) {
            const int byte = std::countr_zero(told) / 8;
            body(first + byte, static_cast<std::uint8_t>(window >> 8 * byte));
        }
        return;
    }
#endif
    for (int x = first; x < end; x += 2)
        if (zones[x] != kZoneBorder) body(x, zones[x]);
}

// Whether the pixel (x, y) is half the subject's: 1 or 0, or -1 where that cannot be told. `zones` has
// `width` bytes a row. `values` and `reference` are in cells of 64 pixels, `cells_per_row` to a row; only
// pixels inside `limit` are read.
template <int kChannels>
KINEVOX_HD inline int unmix_border_pixel(int x, int y, int width, const Rect& limit, const std::uint8_t* zones,
                                  const std::uint8_t* values, const std::uint8_t* reference,
                                  int cells_per_row, const BorderParameters& p) {
    float subject[kChannels] = {}, subject_weight = 0, product = 0, energy = 0;
    const auto offset = [&](int px, int py) {
        return (static_cast<long long>(py) * cells_per_row + px / kCellPixels) * (kChannels * kCellPixels) +
               px % kCellPixels;
    };
    const int x0 = x - kBorderReach < limit.x0 ? limit.x0 : x - kBorderReach;
    const int y0 = y - kBorderReach < limit.y0 ? limit.y0 : y - kBorderReach;
    const int x1 = x + kBorderReach + 1 > limit.x1 ? limit.x1 : x + kBorderReach + 1;
    for (int py = y0; py <= y + kBorderReach && py < limit.y1; ++py) {
        const std::uint8_t* row = zones + static_cast<long long>(py) * width;
        // Every second pixel, as on a chessboard, tells as much at half the cost.
        for_each_told(row, x0 + ((x0 + py) & 1), x1, [&](int px, std::uint8_t zone) {
            const std::uint8_t* v = values + offset(px, py);
            const float weight = border_weight(px - x, py - y);
            if (zone == kZoneInside) {
                for (int c = 0; c < kChannels; ++c) subject[c] += weight * v[c * kCellPixels];
                subject_weight += weight;
            } else {
                const std::uint8_t* r = reference + offset(px, py);
                for (int c = 0; c < kChannels; ++c) {
                    const float level = r[c * kCellPixels];
                    product += weight * level * v[c * kCellPixels];
                    energy += weight * level * level;
                }
            }
        });
    }
    if (subject_weight <= 0) return -1;
    float light = energy > 0 ? product / energy : 1.0f;
    light = light < 0.3f ? 0.3f : light > 1.3f ? 1.3f : light;
    float along = 0, contrast = 0;
    const std::uint8_t* v = values + offset(x, y);
    const std::uint8_t* r = reference + offset(x, y);
    for (int c = 0; c < kChannels; ++c) {
        const float background = light * r[c * kCellPixels];
        const float step = subject[c] / subject_weight - background;
        along += (v[c * kCellPixels] - background) * step;
        contrast += step * step;
    }
    if (contrast < p.min_contrast) return -1;
    return along > p.subject_part * contrast ? 1 : 0;
}

}  // namespace kinevox::kernels::kde
