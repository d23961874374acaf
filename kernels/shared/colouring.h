// What decides about a surface voxel's colours; used by the CPU and the CUDA form.
#pragma once

#include <cstdint>

#include "kernels/shared/device.h"

namespace kinevox::kernels {

// A cell of a picture (2^shift px on each side, about a voxel's size) and its eight neighbours: mean and standard
// deviation per channel, B G R, grey levels.
struct CellColour {
    std::uint8_t mean[3] = {};
    std::uint8_t deviation[3] = {};
    std::uint8_t filled = 0;  // 0: no picture here
    std::uint8_t unused = 0;
};

// How many times the allowed spread two cells' means lie apart, the worst channel.
KINEVOX_HD KINEVOX_INLINE float disagreement(const CellColour& a, const CellColour& b, float noise_grey) {
    float worst = 0;
    for (int c = 0; c < 3; ++c) {
        const int gap = a.mean[c] > b.mean[c] ? a.mean[c] - b.mean[c] : b.mean[c] - a.mean[c];
        const int spread = a.deviation[c] > b.deviation[c] ? a.deviation[c] : b.deviation[c];
        const float ratio = static_cast<float>(gap) / (noise_grey + static_cast<float>(spread));
        worst = worst > ratio ? worst : ratio;
    }
    return worst;
}

}  // namespace kinevox::kernels
