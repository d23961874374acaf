// A trial in the formats of other programs. Each function returns the file's bytes, little endian and with \n
// line ends on every machine. Withheld values are NaN, empty or marked invalid, depending on the format.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <string>

#include "common/geometry.h"
#include "server/recording/trial.h"

namespace kinevox {

// OpenSim's axes: x as in the world, y up, z = -y of the world. Marker positions for inverse kinematics, mm.
std::string trc_file(const Trial& trial, const std::string& file_name);

// Model coordinates by the names, axes and orders of OpenSim's full-body models (Hamner et al. 2010,
// Rajagopal et al. 2016), degrees and metres. The pelvis is converted: OpenSim orders its angles tilt, list,
// rotation, and its origin is the midpoint of the anterior spines. FailedPrecondition without coordinates or
// body.
absl::StatusOr<std::string> mot_file(const Trial& trial);
// The range of pelvis_rotation in that file, which these models clamp at 90 deg. Both 0 without a pose.
struct AngleRange {
    double min_rad = 0, max_rad = 0;
};
AngleRange mot_pelvis_rotation(const Trial& trial);

// Points in mm, world axes (z up), Intel floats; invalid points have residual -1. InvalidArgument beyond the
// format's number of frames.
absl::StatusOr<std::string> c3d_file(const Trial& trial);

// Frames without a value of their own.
struct BvhGaps {
    std::int64_t bridged_frames = 0;  // single lost frame sets, which repeat the frame before
    std::int64_t held_frames = 0;     // in which a withheld value repeats the last one
};
// A skeleton of the body's segments in cm, x to the subject's left, y up, z forward; the world's axes
// likewise. The shoulder girdle, which has no joint of its own, becomes a joint at the clavicle that points
// to the shoulder: a raised arm is offset by about 1 cm. BVH has no missing values: a single lost frame
// repeats the one before; for any other FailedPrecondition names the first one, unless `hold_withheld`
// repeats the last measured value of that coordinate.
absl::StatusOr<std::string> bvh_file(const Trial& trial, bool hold_withheld, BvhGaps* gaps = nullptr);

// All values in one table, units in the header.
std::string csv_file(const Trial& trial);

// Rotations as three angles about axes in any order, for the formats that store such.

enum Axis : int { kAxisX, kAxisY, kAxisZ };
using EulerOrder = std::array<Axis, 3>;     // three different axes
using EulerAngles = std::array<double, 3>;  // rad

// R = R_first(angles[0]) * R_second(angles[1]) * R_third(angles[2]). At the singular pose the third angle is
// 0.
EulerAngles euler_from_rotation(const Mat3& rotation, const EulerOrder& order);
Mat3 rotation_from_euler(const EulerAngles& angles, const EulerOrder& order);

// The same rotation by the angles nearest to `previous`: with full turns added, and by the other of the two
// equivalent triples if that is nearer, so that curves over time are continuous.
EulerAngles nearest_euler(const EulerAngles& angles, const EulerAngles& previous);

}  // namespace kinevox
