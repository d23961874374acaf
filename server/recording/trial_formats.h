// A trial in the formats of other programs. Each function returns the whole file's bytes; files are little
// endian and end their lines with \n on every machine. What was withheld is NaN, empty or marked invalid, as
// each format has it.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <string>

#include "server/recording/trial.h"

namespace kinevox {

// OpenSim's axes: x as in the world, y up, z = -y of the world. Marker positions for inverse kinematics, mm.
std::string trc_file(const Trial& trial, const std::string& file_name);

// Generalised coordinates by the names, axes and orders of OpenSim's full-body models (Hamner et al. 2010,
// Rajagopal et al. 2016), degrees and metres. Those order the pelvis' angles tilt, list, rotation, and its
// origin is the middle of the anterior spines; both are converted to. FailedPrecondition without coordinates
// or body.
absl::StatusOr<std::string> mot_file(const Trial& trial);
// The pelvis_rotation of that file; beyond 90 deg those models clamp it. Both 0 without a pose.
struct AngleRange {
    double min_rad = 0, max_rad = 0;
};
AngleRange mot_pelvis_rotation(const Trial& trial);

// Points in mm, world axes (z up), Intel floats; invalid points have residual -1. InvalidArgument beyond what
// the format counts.
absl::StatusOr<std::string> c3d_file(const Trial& trial);

// A skeleton of the body's segments in cm, x to the subject's left, y up, z forward; the world's axes
// likewise. The shoulder girdle, which has no joint of its own, becomes a joint at the clavicle that points
// to the shoulder: an arm that is raised lies about 1 cm beside the trial's. BVH cannot say that a value is
// missing: FailedPrecondition names the first one, unless `hold` allows to repeat the last measured value of
// the same coordinate; `held`, if given, then tells in how many frames that was done.
absl::StatusOr<std::string> bvh_file(const Trial& trial, bool hold, std::int64_t* held = nullptr);

// All there is in one table with the units in its header.
std::string csv_file(const Trial& trial);

}  // namespace kinevox
