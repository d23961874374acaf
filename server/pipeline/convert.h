// The kernels' plain types from the common ones and back.
#pragma once

#include <optional>

#include "common/camera.h"
#include "common/volume.h"
#include "kernels/types.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

kernels::CameraModel to_kernel(const Camera& camera);
kernels::PictureView to_kernel(const Picture& picture);
Volume to_common(const kernels::VoxelVolume& volume);

// The shape with voxels of four times the edge, each occupied if any of its voxels is; no colours. For what
// only needs to be about right, at a sixteenth of the surface. The lattice may grow.
void coarsen_by_four(const kernels::VoxelVolume& volume, kernels::VoxelVolume& out);

// The centre of gravity, m, to about a voxel: bricks count at their middles. Nothing for an empty volume.
std::optional<Vec3> centre_of(const kernels::VoxelVolume& volume);

}  // namespace kinevox
