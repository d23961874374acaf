// Photo-consistency of a surface voxel; used by the CPU and the CUDA form.
#pragma once

#include <cstdint>

#include "kernels/shared/device.h"

namespace kinevox::kernels {

// A cell of a image (2^shift px on each side, about a voxel's size) and its eight neighbours, per channel,
// B G R, in grey levels: the mean, and the maximum difference of another view's mean.
struct CellColour {
    std::uint8_t mean[3] = {};
    std::uint8_t filled = 0;  // 0: no image here
    std::uint8_t limit[3] = {};
    std::uint8_t unused = 0;
};

// Where a cell's own mean colour is in a image of `columns` cells a row with a rim of one cell around it,
// in cells.
KINEVOX_HD inline int mean_index(int cell, int columns) {
    const int row = cell / columns;
    return (row + 1) * (columns + 2) + (cell - row * columns) + 1;
}

// CellColour::limit for a standard std_grey, both in grey levels.
KINEVOX_HD inline std::uint8_t colour_limit(std::uint8_t std_grey, float max_difference_std,
                                            float noise_grey) {
    const float limit = max_difference_std * (noise_grey + static_cast<float>(std_grey));
    return static_cast<std::uint8_t>(limit < 255.f ? limit : 255.f);
}

// True if the means of two views' cells differ by more than the larger of both limits in any channel.
KINEVOX_HD KINEVOX_INLINE bool disagree(const CellColour& a, const CellColour& b) {
    bool any = false;
    for (int c = 0; c < 3; ++c) {
        const int gap = a.mean[c] > b.mean[c] ? a.mean[c] - b.mean[c] : b.mean[c] - a.mean[c];
        const int limit = a.limit[c] > b.limit[c] ? a.limit[c] : b.limit[c];
        any = any || gap > limit;
    }
    return any;
}

}  // namespace kinevox::kernels
