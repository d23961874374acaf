#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernels/cpu/visibility.h"
#include "kernels/shared/colouring.h"
#include "kernels/types.h"

namespace kinevox::kernels {

// The colours of an image's cells of 2^shift px; cells at the image's edge average only the part inside. Both
// vectors are empty if there is no image.
struct CellColours {
    std::vector<std::uint8_t>
        means;  // B, G, R of each cell alone; rows of width + 2 cells: there is a rim of one
    std::vector<CellColour> cells;  // of 3 x 3 cells around each

    void clear() { means.clear(), cells.clear(); }
};

using ColourLimits = std::array<std::uint8_t, 256>;  // colour_limit() of each value of sigma

// Fills `out` for the cells in which the view can see the volume (view.spans); `limits` null: omits
// out.cells.
void make_cell_colours(const ImageView& image, const ViewOfVolume& view, const ColourLimits* limits,
                       CellColours& out);

}  // namespace kinevox::kernels
