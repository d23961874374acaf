// Silhouettes as a device returns them: masks of a bit per pixel, and only of the cells that were searched.
#pragma once

#include <cstdint>

#include "kernels/segmentation.h"

namespace kinevox::kernels::cpu {

struct PackedSilhouettes {
    int width = 0, height = 0;  // of the image
    Rect searched;              // x0 and the row's end are those of cells; x1 at most `width`
    Rect found;                 // the part of it that may hold anything, likewise
    // [row][cell] of `searched`, kde::kCellPixels pixels a cell, the first one in the lowest bit.
    const unsigned long long *sharp = nullptr, *loose = nullptr;
    const std::uint8_t* probability = nullptr;  // [row][cell][64]
};

// Fills the images of `out`, whose memory is reused: what they held is 0 outside the rectangles of `out`.
void unpack(const PackedSilhouettes& packed, Silhouettes& out);

}  // namespace kinevox::kernels::cpu
