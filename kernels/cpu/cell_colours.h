#pragma once

#include <cstdint>
#include <vector>

#include "kernels/shared/colouring.h"
#include "kernels/types.h"

namespace kinevox::kernels {

// Mean and spread of 3 x 3 cells around each cell of `cells` (cells of 2^shift px; the part of the picture that
// ends within a cell is left out of its mean).
void make_cell_colours(const PictureView& picture, int shift, const Rect& cells, std::vector<CellColour>& out,
                       std::vector<std::uint8_t>& scratch);

}  // namespace kinevox::kernels
