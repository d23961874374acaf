#pragma once

#include <span>
#include <vector>

#include "kernels/colouring.h"
#include "kernels/cpu/surface.h"
#include "kernels/cpu/visibility.h"

namespace kinevox::kernels {

// Colours the surface voxels of one brick: the mean over the cameras that see a voxel, those that look at its open
// sides squarely and from near counting most; where none sees it, over all that look its way.
void paint_brick(std::span<const ColouringView> views, const std::vector<ViewOfVolume>& of_volume,
                 VoxelVolume& volume, const Surface& surface, int brick);

}  // namespace kinevox::kernels
