// kde::unmix_border_pixel() for every pixel of a silhouette's border, row by row, with SIMD if available.
#pragma once

#include <cstdint>

#include "kernels/shared/kde_border.h"
#include "kernels/types.h"

namespace kinevox::kernels::cpu {

struct BorderImages {
    int width = 0;                            // of `zones`, px
    Rect limit;                               // of the image, the part that may be read
    const std::uint8_t* zones = nullptr;      // kde::kZone..., `width` bytes a row and 8 more at the end
    const std::uint8_t* values = nullptr;     // [row][cell][channel][64]
    const std::uint8_t* reference = nullptr;  // the same of the background
    int cells_per_row = 0, channels = 0;
    kde::BorderParameters parameters;
};

// Writes 0 or 255 to `sharp`, row `y` of the mask, for the border pixels in [x0, x1) that can be decided.
void unmix_row(const BorderImages& images, int y, int x0, int x1, std::uint8_t* sharp);

}  // namespace kinevox::kernels::cpu
