// The voxels of one brick, tested against every view.
#pragma once

#include <cstdint>

#include "kernels/shared/hull.h"

namespace kinevox::kernels {

// Clears in occupancy[8] (see Brick) the voxels that the views reject; rows without a voxel cost nothing. The
// first voxel's centre is at (x, y, z), m. `inside` has a bit for each view that is known to contain the
// whole brick (decide_block()), which then need not be asked. True: any voxel is left.
bool carve_brick(const HullMaps* views, int view_count, std::uint64_t inside, int min_views, float x, float y,
                 float z, float voxel_m, std::uint64_t* occupancy);

}  // namespace kinevox::kernels
