// A person of 34 tapered capsules and cameras around it, for tests and benchmarks.
#pragma once

#include <vector>

#include "kernels/body_silhouette.h"

namespace kinevox::kernels::testing {

// About 1.75 m tall, standing at (x, y, 0), turned by `heading` rad; `stride` rad swings arms and legs.
std::vector<TaperedCapsule> capsule_person(float x, float y, float heading, float stride);

// A camera of width x height px at `from`, looking at `at` (world, m), upright.
CameraModel camera_looking(const float from[3], const float at[3], int width, int height, float focal_px);

}  // namespace kinevox::kernels::testing
