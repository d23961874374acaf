// A pose's silhouettes from all directions, one bit per pixel, compressed together.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace kinevox {

// Adds a mask of side_px * side_px bytes (0 or not) to `bits`, row by row, the leftmost pixel in the lowest
// bit.
void append_bits(const std::vector<std::uint8_t>& mask, std::string& bits);
std::string compress_silhouettes(const std::string& bits);

// Image number `index`; empty if the bytes are damaged or there is no such image.
std::vector<std::uint8_t> unpack_silhouette(const std::string& compressed, int side_px, int index);

}  // namespace kinevox
