// How well the space in which people move is covered: by the cameras' views, and by what was shown to
// calibrate them.
#pragma once

#include <optional>
#include <vector>

#include "common/camera.h"

namespace kinevox {

struct VolumeCoverage {
    Vec3 lower, upper;       // m, world: the box judged
    double seen_by_two = 0;  // part of it that two or more cameras see, 0 to 1
    double seen_by_three = 0;
    double calibrated =
        0;  // part of it within `reach` of a point seen by two or more cameras while calibrating
};

// `points`: what was seen while calibrating, m. An empty box (upper not above lower) is laid around them.
VolumeCoverage volume_coverage(const std::vector<Camera>& cameras, const std::vector<Vec3>& points,
                               Vec3 lower, Vec3 upper);

// The same for the box around what was shown, where the world's floor is known: from the floor up to a
// person's raised hands at least. Nothing for fewer than three points.
std::optional<VolumeCoverage> working_volume(const std::vector<Camera>& cameras,
                                             const std::vector<Vec3>& points);

}  // namespace kinevox
