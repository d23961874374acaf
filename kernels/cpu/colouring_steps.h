// The steps of a carving round on the CPU, each for one brick or one view.
#pragma once

#include <cstdint>
#include <span>

#include "kernels/colouring.h"
#include "kernels/cpu/cell_colours.h"
#include "kernels/cpu/surface.h"
#include "kernels/cpu/visibility.h"

namespace kinevox::kernels {

// Bounding box of the non-zero pixels.
Rect bounds_of(const std::uint8_t* mask, int width, int height);

// Intersection over union of the volume's projection (of_volume.depths, as written by look_at_surface()) and
// the view's sharp silhouette, or its loose one if there is no sharp one; NaN if there is neither or both
// masks are empty.
float silhouette_iou(const ColouringView& view, const ViewOfVolume& of_volume);

// Colours the surface voxels of one brick: the weighted mean over the cameras that see a voxel, with most
// weight on near cameras facing its open sides; if none sees it, over all cameras that face it.
void paint_brick(std::span<const CellColours> colours, std::span<const ViewOfVolume> of_volume,
                 const Surface& surface, int brick, VoxelVolume& volume);

inline constexpr int kMaxSupportRadius = 7;  // voxels

// Marks in unsupported[8] (bits as Brick::occupancy) the voxels of a brick, occupied or not, with fewer than
// `min_count` occupied voxels in the cube of 2 * radius + 1 voxels around them, themselves included. 1 <=
// radius
// <= kMaxSupportRadius.
void find_unsupported(const VoxelVolume& volume, const BrickGrid& grid, int brick, int radius, int min_count,
                      std::uint64_t* unsupported);

}  // namespace kinevox::kernels
