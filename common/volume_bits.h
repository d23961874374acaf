// Bit tricks on bricks that volume.cc and volume_codec.cc share. A slice is one z of a brick: 64 voxels, bit
// (y * 8 + x).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "common/volume.h"

namespace kinevox {

using BrickBits = std::array<std::uint64_t, 8>;

// For each brick the surface voxels: occupied, with one of the six neighbours empty. Bricks sorted, inside
// the grid.
std::vector<BrickBits> surface_bits(const VolumeGrid& grid, std::span<const VolumeBrick> bricks);

namespace volume_bits {

// Exchanges bits `high` and `low` of every bit's index.
template <int high, int low>
constexpr std::uint64_t swap_index_bits(std::uint64_t slice) {
    std::uint64_t mask = 0;  // where index bit `high` is 0 and `low` is 1
    for (int i = 0; i < 64; ++i)
        if (!(i >> high & 1) && (i >> low & 1)) mask |= std::uint64_t{1} << i;
    constexpr int distance = (1 << high) - (1 << low);
    const std::uint64_t changed = ((slice >> distance) ^ slice) & mask;
    return slice ^ changed ^ (changed << distance);
}

// Index bits y2 y1 y0 x2 x1 x0 to y2 x2 y1 x1 y0 x0 and back: then each aligned 2 x 2 block is a nibble, each
// aligned 4 x 4 block 16 bits.
constexpr std::uint64_t morton_from_slice(std::uint64_t slice) {
    return swap_index_bits<2, 1>(swap_index_bits<3, 2>(swap_index_bits<4, 2>(slice)));
}
constexpr std::uint64_t slice_from_morton(std::uint64_t morton) {
    return swap_index_bits<4, 2>(swap_index_bits<3, 2>(swap_index_bits<2, 1>(morton)));
}

}  // namespace volume_bits
}  // namespace kinevox
