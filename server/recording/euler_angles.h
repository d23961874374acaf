// Rotations as three angles about axes in any order.
#pragma once

#include <array>

#include "common/geometry.h"

namespace kinevox {

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
