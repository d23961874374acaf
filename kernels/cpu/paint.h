#pragma once

#include <span>

#include "kernels/cpu/cell_colours.h"
#include "kernels/cpu/surface.h"
#include "kernels/cpu/visibility.h"

namespace kinevox::kernels {

// Colours the surface voxels of one brick: the mean over the cameras that see a voxel, those that look at its
// open sides squarely and from near counting most; where none sees it, over all that look its way.
void paint_brick(std::span<const CellColours> colours, std::span<const ViewOfVolume> of_volume,
                 const Surface& surface, int brick, VoxelVolume& volume);

}  // namespace kinevox::kernels
