// Virtual cameras aimed at the subject, which normalise position and perspective: same centre as the real
// camera, axis through the tracked centre, upright, without distortion, and with a focal length such that a
// metre at the subject's distance is always the same number of pixels. Only the viewing direction (azimuth,
// elevation) and, weakly, the distance remain; they are the keys of the database.
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
    Vec3 right, down;             // the image axes in the world, unit vectors
    kernels::CameraModel camera;  // side_px x side_px, no distortion
};

// The target is at the image centre; each edge is `half_width_m` from it.
AimedView aimed_view(Vec3 camera_in_world, Vec3 target_in_world, double half_width_m, int side_px);

Vec3 camera_centre(const kernels::CameraModel& camera);

// A real camera's silhouette as seen by the aimed camera.
struct AimedSilhouette {
    std::vector<std::uint8_t> mask;  // side_px * side_px, 0 or 255
    kernels::Rect bounds;            // around what is set
    int pixels = 0;                  // number set
    bool truncated = false;          // touches the border of the real image
};
void rectify_silhouette(const kernels::CameraModel& camera, const std::uint8_t* silhouette,
                        const kernels::Rect& bounds, const AimedView& view, AimedSilhouette& out);

}  // namespace kinevox
