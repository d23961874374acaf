#include "server/recording/euler_angles.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace kinevox {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

double turned_to(double angle, double previous) {
    return previous + std::remainder(angle - previous, kTurn);
}

double distance(const EulerAngles& a, const EulerAngles& b) {
    return std::abs(a[0] - b[0]) + std::abs(a[1] - b[1]) + std::abs(a[2] - b[2]);
}

Mat3 about(Axis axis, double angle) {
    return axis == kAxisX ? rotation_x(angle) : axis == kAxisY ? rotation_y(angle) : rotation_z(angle);
}

}  // namespace

EulerAngles euler_from_rotation(const Mat3& r, const EulerOrder& order) {
    const auto [i, j, k] = order;
    const double sign = (i + 1) % 3 == j ? 1 : -1;  // of the permutation
    const double sine = std::clamp(sign * r(i, k), -1.0, 1.0);
    constexpr double kSingular = 1 - 1e-12;
    if (std::abs(sine) > kSingular) return {std::atan2(sign * r(k, j), r(j, j)), std::asin(sine), 0};
    return {std::atan2(-sign * r(j, k), r(k, k)), std::asin(sine), std::atan2(-sign * r(i, j), r(i, i))};
}

Mat3 rotation_from_euler(const EulerAngles& angles, const EulerOrder& order) {
    return about(order[0], angles[0]) * about(order[1], angles[1]) * about(order[2], angles[2]);
}

EulerAngles nearest_euler(const EulerAngles& angles, const EulerAngles& previous) {
    EulerAngles same, other;
    for (int n = 0; n < 3; ++n) {
        same[n] = turned_to(angles[n], previous[n]);
        const double mirrored = n == 1 ? std::numbers::pi - angles[n] : angles[n] + std::numbers::pi;
        other[n] = turned_to(mirrored, previous[n]);
    }
    return distance(other, previous) < distance(same, previous) - 1e-9 ? other : same;
}

}  // namespace kinevox
