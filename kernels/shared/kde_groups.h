// Which pixels the evidence is worked out for: those near a pixel that may be foreground, by groups that fit
// a vector register. CPU and CUDA look at the same ones.
#pragma once

#include <cstdint>

#include "kernels/shared/device.h"
#include "kernels/shared/kde_density.h"

namespace kinevox::kernels::kde {

inline constexpr int kGroupPixels = 16;
inline constexpr int kActiveMargin =
    4;  // px in rows and columns: radius of the light's neighbourhood plus that of the smoothing
inline constexpr int kSlices = kCellPixels / kActiveMargin;  // of a cell, as wide as the margin

// Groups of a cell as bits, from the left; beside them those of the cells to the left and to the right.
inline constexpr int kAllGroups = (1 << kCellPixels / kGroupPixels) - 1;
inline constexpr int kLastGroup = (kAllGroups + 1) / 2;
inline constexpr int kNearLeft = kAllGroups + 1, kNearRight = 2 * kNearLeft;

// The groups within the margin of unsure pixels. slices: a bit for each slice that holds such a pixel.
KINEVOX_HD inline int groups_near(int slices) {
    constexpr int kSlicesOfGroup = kGroupPixels / kActiveMargin;
    const int wide = slices | slices << 1 | slices >> 1;
    int groups = (slices & 1 ? kNearLeft : 0) | (slices >> (kSlices - 1) & 1 ? kNearRight : 0);
    for (int g = 0; g < kCellPixels / kGroupPixels; ++g)
        if (wide >> g * kSlicesOfGroup & ((1 << kSlicesOfGroup) - 1)) groups |= 1 << g;
    return groups;
}

}  // namespace kinevox::kernels::kde
