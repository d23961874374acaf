// Coverage of the capture volume by the cameras' views and by the target points seen while calibrating.
#pragma once

#include <optional>
#include <vector>

#include "common/camera.h"

namespace kinevox {

struct VolumeCoverage {
    Vec3 lower, upper;             // m, world: the box
    double two_view_fraction = 0;  // fraction seen by two or more cameras, 0 to 1
    double three_view_fraction = 0;
    double calibrated_fraction = 0;  // fraction near a target point seen by two or more cameras
};

// `points`: target points, m. An empty box (upper not above lower) is replaced by their bounding box.
VolumeCoverage volume_coverage(const std::vector<Camera>& cameras, const std::vector<Vec3>& points,
                               Vec3 lower, Vec3 upper);

// The same for the box around the target points with a known floor: from the floor up to at least a person's
// raised hands. Empty for fewer than three points.
std::optional<VolumeCoverage> working_volume(const std::vector<Camera>& cameras,
                                             const std::vector<Vec3>& points);

}  // namespace kinevox
