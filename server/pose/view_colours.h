// The colours of a subject in one camera's image, on a coarse grid: evidence within a silhouette.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernels/segmentation.h"
#include "kernels/types.h"

namespace kinevox {

struct ViewColours {
    int x0 = 0, y0 = 0, cell = 1;  // px, of the image
    int columns = 0, rows = 0;
    // Row by row: mean of the cell's silhouette pixels in the image's channels, and whether most of the cell
    // is in the silhouette.
    std::vector<std::array<std::uint8_t, 3>> colour;
    std::vector<std::uint8_t> inside;
    bool empty() const { return inside.empty(); }
};

// About `side` cells along the longer side of the silhouettes' box. Reuses the memory of `out`; empty without
// an image, without a silhouette and with 0 cells.
void read_colours(const kernels::ImageView& image, const kernels::Silhouettes& silhouettes, int side,
                  ViewColours& out);

}  // namespace kinevox
