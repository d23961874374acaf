// The basis functions' integrals over the cells of one quadrant, made once for an order and a grid and then
// shared.
#pragma once

#include <array>
#include <memory>
#include <utility>
#include <vector>

#include "kernels/cpu/aligned_vector.h"
#include "kernels/moments.h"
#include "kernels/shared/moments.h"

namespace kinevox::kernels {

struct MomentTables {
    int order = 0, grid = 0, half = 0;  // half: cells along the quadrant's edge
    std::vector<int> row_cells;         // per row of the quadrant, outwards: cells kept, a multiple of 8
    std::vector<int> row_start;         // and where they begin; one entry more than rows
    int cells = 0;                      // kept altogether

    struct Function {
        int value;  // index in SilhouetteMoments::values
        int row;    // in `weights`
    };
    std::array<std::vector<Function>, kMomentFolds> functions;
    cpu::AlignedVector<float>
        weights;  // [function][cell]; with (p + 1) / pi, the cell's area and conj's sign
};

// Thread safe.
std::shared_ptr<const MomentTables> moment_tables(int order, int grid);

}  // namespace kinevox::kernels
