// Selects the cells of the image that are searched in a frame.
#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/segmentation.h"

namespace kinevox::kernels::cpu {

// Groups of kde::kGroupPixels pixels, [g0, g1) of a row.
struct GroupSpan {
    int g0 = 0, g1 = 0;
    bool empty() const { return g1 <= g0; }
    void include(const GroupSpan& other) {
        if (other.empty()) return;
        *this = empty() ? other : GroupSpan{std::min(g0, other.g0), std::max(g1, other.g1)};
    }
};

// From the first to the last of a cell's groups, as bits and not 0, in the row.
GroupSpan groups_of_cell(int cell, int groups);

// Which groups of a cell, and beside it, are near its unsure pixels (kde::groups_near).
int groups_near_unsure(const std::uint8_t* density);

// Rows [y0, y1) of cells [k0, k1).
struct CellBox {
    int y0 = 0, y1 = 0, k0 = 0, k1 = 0;
    bool empty() const { return y1 <= y0 || k1 <= k0; }
};

// Sets searched[row][cell] to 1 for the cells of `work` where the subject can be, else to 0. These are all
// cells of `work`, or, if the prior has max_distance_px, those within it of the expected subject, and those
// along the image borders that the region touches, where something unexpected may enter.
void mark_searched(const SegmentationPrior& prior, const CellBox& work, int width, int height,
                   std::uint8_t* searched);

}  // namespace kinevox::kernels::cpu
