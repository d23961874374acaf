// The shape of a volume as four byte strings: where the bricks are, and each brick as an octree of three
// levels whose branches end where everything is empty or full. docs/volume_format.md describes them byte for
// byte.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/volume.h"

namespace kinevox {

struct ShapeSections {
    std::vector<std::uint8_t> gaps;     // between bricks, variable length
    std::vector<std::uint8_t> bricks;   // 2 a brick: which 4^3 octants are not empty, which are full
    std::vector<std::uint8_t> octants;  // 2 an octant that is neither: the same of its 2^3 cells
    std::vector<std::uint8_t> cells;    // 1 a cell that is neither: its voxels
};

// The volume must have no volume_problem().
ShapeSections encode_shape(const Volume& volume);

struct ShapeBytes {
    std::span<const std::uint8_t> gaps, bricks, octants, cells;
};

// The reverse; `brick_count` must not exceed kMaxBricks. Returns what is wrong, empty if nothing is.
std::string decode_shape(const ShapeBytes& sections, std::size_t brick_count, Volume& volume);

}  // namespace kinevox
