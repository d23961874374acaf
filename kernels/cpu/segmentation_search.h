// Which cells of the picture a frame's search has to look at.
#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/segmentation.h"

namespace kinevox::kernels::cpu {

// Cells [k0, k1) of a row.
struct CellSpan {
    int k0 = 0, k1 = 0;
    bool empty() const { return k1 <= k0; }
    void include(const CellSpan& other) {
        if (other.empty()) return;
        *this = empty() ? other : CellSpan{std::min(k0, other.k0), std::max(k1, other.k1)};
    }
};

// Rows [y0, y1) of cells [k0, k1).
struct CellBox {
    int y0 = 0, y1 = 0, k0 = 0, k1 = 0;
    bool empty() const { return y1 <= y0 || k1 <= k0; }
};

// Sets searched[row][cell] to 1 for the cells of `work` where the subject can be and to 0 for all others of
// the picture. That is the whole of `work`, unless the prior says how far from what it expects the subject
// reaches: then the cells within that reach, and those along the picture's borders that the region touches,
// since what comes in there was not expected.
void mark_searched(const SegmentationPrior& prior, const CellBox& work, int width, int height,
                   std::uint8_t* searched);

}  // namespace kinevox::kernels::cpu
