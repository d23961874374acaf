// The kernel density of one pixel in 8-bit steps (paper 3.1; Elgammal et al. 2000, eq. 3), the form that fits
// 64 pixels into a vector register. CPU and CUDA give the same bits.
//
// A sample's distance in a channel is counted in quarters of that pixel's bandwidth (0..15), squared by a
// table, summed over the channels and turned into a kernel value by a second table. The sum over the samples
// saturates at 255: by then the pixel is background beyond doubt.
#pragma once

#include <cstdint>

#include "kernels/shared/device.h"

namespace kinevox::kernels::kde {

// Pixels that lie together in memory: samples, bandwidths and images are stored as [cell][..][channel][64].
inline constexpr int kCellPixels = 64;

// The density at which a pixel is background beyond doubt, as a part of the highest one (all samples equal to
// it). A single kernel may be more than that in a small model.
inline constexpr double kSaturation = 0.125;
KINEVOX_HD inline double saturation(int sample_count) {
    return 1.0 / sample_count > kSaturation ? 1.0 / sample_count : kSaturation;
}

// A cell with fewer pixels than this below the sure density holds noise at most, whatever its neighbours are.
// Whether it does is looked at after every few samples, so that plain background costs a part of the samples.
inline constexpr int kSureDensity = 8;
inline constexpr int kCandidatesPerCell = 3;
inline constexpr int kSamplesPerLook = 4;

struct DensityTables {
    std::uint8_t squared[16];  // of a distance in quarters of a bandwidth, 1/16 bandwidth^2
    std::uint8_t kernel[16];   // of a summed squared distance in whole bandwidth^2; 0 at 15
};

// Distance of a sample: bandwidth_scale is 256 / bandwidth (grey levels), 1..255.
KINEVOX_HD inline int distance_index(int value, int sample, int bandwidth_scale) {
    const int difference = value > sample ? value - sample : sample - value;
    const int index = (difference * bandwidth_scale) >> 6;
    return index < 15 ? index : 15;
}

// The kernel of a summed squared distance; both saturate as 8-bit vectors do.
KINEVOX_HD inline int kernel_of(const DensityTables& tables, int squared_sum) {
    const int sum = squared_sum < 255 ? squared_sum : 255;
    const int rounded = sum + 8 < 255 ? sum + 8 : 255;
    return tables.kernel[rounded >> 4];
}

// value: `channels` bytes `value_step` apart; samples: [sample][channel], steps in bytes; 0..255.
KINEVOX_HD inline int density(const DensityTables& tables, const std::uint8_t* value,
                              const std::uint8_t* samples, const std::uint8_t* bandwidth_scale,
                              int sample_count, int channels) {
    int sum = 0;
    for (int i = 0; i < sample_count && sum < 255; ++i) {
        int squared = 0;
        for (int c = 0; c < channels; ++c) {
            const int at = c * kCellPixels;
            squared += tables.squared[distance_index(value[at], samples[(i * channels + c) * kCellPixels],
                                                     bandwidth_scale[at])];
        }
        sum += kernel_of(tables, squared);
    }
    return sum < 255 ? sum : 255;
}

}  // namespace kinevox::kernels::kde
