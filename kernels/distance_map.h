// Distances of the cells of a grid to the border between its two kinds of cells.
#pragma once

#include <cstdint>

namespace kinevox::kernels {

inline constexpr int kMaxDistanceMapSide = 16384;  // cells

// Exact Euclidean distances in cells between centres, less half a cell: positive where `inside` is not 0, to
// the nearest cell that is 0, and negative elsewhere. At least kMaxDistanceMapSide - 1 of either sign where
// all cells are of one kind. Both arrays hold rows of `columns` cells. Throws std::invalid_argument for a
// grid without cells or with more than kMaxDistanceMapSide along a side.
void signed_distances(const std::uint8_t* inside, int columns, int rows, float* distance);

}  // namespace kinevox::kernels
