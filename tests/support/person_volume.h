// A coloured volume about as large and as rough as a clothed person's hull, from capsules: for tests and
// benchmarks that need no data.
#pragma once

#include <functional>

#include "common/volume.h"

namespace kinevox::testing {

// The volume of what `inside` says of each voxel's centre (m, world), without colours.
Volume volume_of(const VolumeGrid& grid, const std::function<bool(Vec3)>& inside);

Vec3 voxel_centre_in_world(const VolumeGrid& grid, VoxelIndex voxel);

// A standing person of 1.8 m, arms half raised, with patterned clothes and some noise in the colours. About
// 130 litres, as a plain hull from four cameras.
Volume person_volume(double voxel_m);

}  // namespace kinevox::testing
