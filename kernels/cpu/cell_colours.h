#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernels/cpu/visibility.h"
#include "kernels/shared/colouring.h"
#include "kernels/types.h"

namespace kinevox::kernels {

// The colours of a picture's cells (of 2^shift px; the part of the picture that ends within a cell is left
// out of its mean). Both are empty where there is no picture.
struct CellColours {
    std::vector<std::uint8_t>
        means;  // B, G, R of each cell alone; rows of width + 2 cells: there is a rim of one
    std::vector<CellColour> cells;  // of 3 x 3 cells around each

    void clear() { means.clear(), cells.clear(); }
};

using ColourLimits = std::array<std::uint8_t, 256>;  // colour_limit() of each deviation

// Fills `out` for the cells that the view can see the volume in (view.spans); `limits` null: without
// out.cells.
void make_cell_colours(const PictureView& picture, const ViewOfVolume& view, const ColourLimits* limits,
                       CellColours& out);

}  // namespace kinevox::kernels
