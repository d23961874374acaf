// Converts between the kernels' plain types and the common ones.
#pragma once

#include <optional>

#include "common/volume.h"
#include "kernels/types.h"
#include "server/silhouettes/to_kernel.h"

namespace kinevox {

Volume to_common(const kernels::VoxelVolume& volume);

// The shape with voxels of four times the edge, each occupied if any of its voxels is; no colours. For
// approximate uses, with a sixteenth of the surface. The lattice may grow.
void coarsen_by_four(const kernels::VoxelVolume& volume, kernels::VoxelVolume& out);

// The centre of gravity, m, to about a voxel, from the centres of the bricks. Empty for an empty volume.
std::optional<Vec3> centre_of(const kernels::VoxelVolume& volume);
// Height below which the legs of a body on the floor (z = 0) are not in its volume, m, to a brick's edge: the
// top of the highest layer of bricks in its lower half that holds less than an ankle. 0 where none does.
double legs_missing_below(const kernels::VoxelVolume& volume);

}  // namespace kinevox
