// How much of the volume surrounds a voxel.
#pragma once

#include <cstdint>

#include "kernels/cpu/surface.h"

namespace kinevox::kernels {

inline constexpr int kMaxSupportRadius = 7;  // voxels

// Marks in thin[8] (bits as Brick::occupancy) the places of a brick, occupied or not, that have fewer than
// `least` occupied voxels in the cube of 2 * radius + 1 voxels around them, themselves included. 1 <= radius
// <= kMaxSupportRadius.
void find_thin(const VoxelVolume& volume, const BrickGrid& grid, int brick, int radius, int least,
               std::uint64_t* thin);

}  // namespace kinevox::kernels
