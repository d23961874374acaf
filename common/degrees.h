// Angles are radians inside and degrees at the edges.
#pragma once

#include <numbers>

namespace kinevox {

constexpr double degrees(double rad) {
    return rad * 180 / std::numbers::pi;
}
constexpr double radians(double deg) {
    return deg * std::numbers::pi / 180;
}
inline constexpr double kDegree = radians(1);

}  // namespace kinevox
