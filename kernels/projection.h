// The projection of a volume as a mask: the tracker's expectation for the next image.
#pragma once

#include <cstdint>

#include "kernels/types.h"

namespace kinevox::kernels {

// Clears `mask` (camera.width * camera.height bytes) and sets to 255 what the volume covers after it was
// moved by `translation_m` (x, y, z; world) in the image of `camera`, wider by `dilate_px` on every side.
// Solid, without pinholes; the contour may be about a voxel too wide. `bounds` is the smallest box around
// what was set, empty if there is nothing. Throws std::invalid_argument for a camera that has no size or
// whose calibration is not finite.
void project_volume(const VoxelVolume& volume, const CameraModel& camera, const float translation_m[3],
                    int dilate_px, std::uint8_t* mask, Rect& bounds);

}  // namespace kinevox::kernels
