// Distance transform of a small image, for the hull's maps.
#pragma once

#include <cstdint>
#include <vector>

namespace kinevox::kernels {

// Chessboard distances by the two raster passes of Rosenfeld and Pfaltz (1966): out[y][x] is the distance to
// the nearest cell whose kind has bit 0, less the distance to the nearest one whose kind has bit 1, both 127
// at most. Around the image all cells have bit 1. kind and out: height * width, and may be the same memory.
void chessboard_distances(int width, int height, const std::uint8_t* kind, std::vector<std::uint8_t>& scratch,
                          std::int8_t* out);

}  // namespace kinevox::kernels
