// The CPU form of the hull, and its steps.
#pragma once

#include <cstdint>
#include <memory>

#include "kernels/hull.h"
#include "kernels/shared/hull.h"

namespace kinevox::kernels {

std::unique_ptr<HullCarver> make_hull_carver_cpu(const HullOptions& options);

// Throws std::invalid_argument, see HullCarver::carve().
void check_lattice(const Lattice& lattice);

// Clears in occupancy[8] (see Brick) the voxels that the views reject; rows without a voxel cost nothing. The
// first voxel's centre is at (x, y, z), m. `inside` has a bit for each view that is known to contain the
// whole brick (decide_block()) and is skipped. True if any voxel is left.
bool carve_brick(const HullMaps* views, int view_count, std::uint64_t inside, int min_views, float x, float y,
                 float z, float voxel_m, std::uint64_t* occupancy);

}  // namespace kinevox::kernels
