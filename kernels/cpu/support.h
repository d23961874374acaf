// How much of the volume surrounds a voxel.
#pragma once

#include <cstdint>

#include "kernels/cpu/surface.h"

namespace kinevox::kernels {

inline constexpr int kMaxSupportRadius = 7;  // voxels

// Occupied voxels in the cube of 2 * radius + 1 voxels around each voxel of a brick, itself included.
// counts[k * 64 + j * 8 + i]. 1 <= radius <= kMaxSupportRadius.
void count_support(const VoxelVolume& volume, const BrickGrid& grid, int brick, int radius,
                   std::uint16_t* counts);

}  // namespace kinevox::kernels
