// The directions of a camera's pixels, for finding the floor point behind each (shared/kde_shadow.h).
#pragma once

#include <vector>

#include "kernels/types.h"

namespace kinevox::kernels {

struct FloorDirections {
    int columns = 0, rows = 0;
    std::vector<float> xy;        // per grid point, x and y at depth 1 in the camera frame
    float centre[3] = {0, 0, 0};  // of the camera, world, m
};

// Of every kde::kFloorGrid_px-th pixel, with one column and row beyond the image. Pixels that the distortion
// model cannot invert get a direction without a floor point.
FloorDirections floor_directions(const CameraModel& camera);

// Bounds of `subject` (px) with a margin for what is not found yet, as kde::SceneView has them; none at sides
// where the image cuts the subject.
void subject_bounds(const Rect& subject, const CameraModel& camera, const FloorDirections& directions,
                    float bounds[4]);

}  // namespace kinevox::kernels
