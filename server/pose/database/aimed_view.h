// Virtual cameras aimed at the subject, so that a person anywhere in the capture space looks like one in the
// middle of the pose database: same eye as the real camera, its axis through the tracked centre, upright,
// without a lens' bend, and so long in focal length that a metre at the centre's distance is always the same
// number of pixels. What is left of the place is the direction (azimuth, elevation) and, weakly, the distance
// from which the body is seen; those are the database's keys.
#pragma once

#include <cstdint>
#include <vector>

#include "common/geometry.h"
#include "kernels/types.h"

namespace kinevox {

struct AimedView {
    double azimuth = 0;    // of the direction from the target to the camera, rad, from x towards y
    double elevation = 0;  // of that direction, rad, up positive
    double distance_m = 0;
    double metres_per_px = 0;     // at the target
    Vec3 right, down;             // the picture's axes in the world, length 1
    kernels::CameraModel camera;  // side_px x side_px, no distortion
};

// The target falls on the picture's middle; from there `half_width_m` reach to each edge.
AimedView aimed_view(Vec3 camera_in_world, Vec3 target_in_world, double half_width_m, int side_px);

Vec3 camera_centre(const kernels::CameraModel& camera);

// A real camera's silhouette as the aimed camera would have seen it.
struct AimedSilhouette {
    std::vector<std::uint8_t> mask;  // side_px * side_px, 0 or 255
    kernels::Rect bounds;            // around what is set
    int pixels = 0;                  // that are set
    bool cut = false;                // the silhouette touches the border of the real picture
};
void take_aim(const kernels::CameraModel& camera, const std::uint8_t* silhouette, const kernels::Rect& bounds,
              const AimedView& view, AimedSilhouette& out);

}  // namespace kinevox
