// Where exactly the silhouette ends. A pixel on the border mixes subject and background, and noise is so
// small against the subject's contrast that a tenth of the subject already counts as foreground: silhouettes
// come out half a pixel to a pixel fat. So each pixel near the border is unmixed between the subject's colour
// a little further in and the background, and belongs to the sharp silhouette if half or more of it is the
// subject.
#pragma once

#include <cstdint>

#include "kernels/shared/host_device.h"
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

// Whether the pixel (x, y) is half the subject's: 1 or 0, or -1 where that cannot be told. `zones` has
// `width` bytes a row. `values` and `reference` are in cells of 64 pixels, `cells_per_row` to a row; only
// pixels inside `limit` are read.
template <int kChannels>
KINEVOX_HD int unmix_border_pixel(int x, int y, int width, const Rect& limit, const std::uint8_t* zones,
                                  const std::uint8_t* values, const std::uint8_t* reference,
                                  int cells_per_row, const BorderParameters& p) {
    float subject[kChannels] = {}, subject_weight = 0, product = 0, energy = 0;
    const auto offset = [&](int px, int py) {
        return (static_cast<long long>(py) * cells_per_row + px / kCellPixels) * (kChannels * kCellPixels) +
               px % kCellPixels;
    };
    const int x0 = x - kBorderReach < limit.x0 ? limit.x0 : x - kBorderReach;
    const int y0 = y - kBorderReach < limit.y0 ? limit.y0 : y - kBorderReach;
    for (int py = y0; py <= y + kBorderReach && py < limit.y1; ++py)
        // Every second pixel, as on a chessboard, tells as much at half the cost.
        for (int px = x0 + ((x0 + py) & 1); px <= x + kBorderReach && px < limit.x1; px += 2) {
            const std::uint8_t zone = zones[static_cast<long long>(py) * width + px];
            if (zone == kZoneBorder) continue;
            const std::uint8_t* v = values + offset(px, py);
            const float weight = 1.0f / (1 + (px - x) * (px - x) + (py - y) * (py - y));
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
