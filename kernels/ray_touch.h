// Where one ray touches one tapered capsule. Inlined into the loop over rays of each processor family.
#pragma once

#include <algorithm>
#include <cmath>

namespace kinevox::kernels {

// See RayTouches in kernels/ray_capsule.h.
struct RayTouch {
    double distance_m, along, gradient[3];
};

// `direction` and `outward` have length 1.
[[gnu::always_inline]] inline RayTouch touch_capsule(const double* direction, const double* outward,
                                                     const double* origin, const float* from, const float* to,
                                                     float radius_a, float radius_b) {
    constexpr double kThin_m = 0.09f;  // maximum movement of a capsule across the border
    constexpr double kOnAxis_m = 1e-9;
    const auto dot = [](const double* u, const double* v) { return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]; };
    const double a[3] = {from[0], from[1], from[2]};
    const double e[3] = {to[0] - a[0], to[1] - a[1], to[2] - a[2]};
    const double w[3] = {a[0] - origin[0], a[1] - origin[1], a[2] - origin[2]};
    const double de = dot(direction, e), da = dot(direction, w), taper = radius_b - radius_a;
    const double q2 = dot(e, e) - de * de + 1e-9, q1 = dot(e, w) - de * da, q0 = dot(w, w) - da * da;
    // The nearest point of the axis, moved on towards the thicker end until the surface's slope is met.
    double t = -q1 / q2;
    const double h = std::sqrt(std::max(q0 + q1 * t, 0.0));
    t += taper * h / (q2 * std::sqrt(std::max(1 - taper * taper / q2, 0.05)));
    t = std::min(std::max(t, 0.0), 1.0);
    const double p[3] = {a[0] + t * e[0] - origin[0], a[1] + t * e[1] - origin[1],
                         a[2] + t * e[2] - origin[2]};
    const double depth = dot(p, direction);
    const double from_ray[3] = {p[0] - depth * direction[0], p[1] - depth * direction[1],
                                p[2] - depth * direction[2]};
    const double length = std::sqrt(dot(from_ray, from_ray)), radius = radius_a + taper * t;
    const bool beyond = dot(from_ray, outward) > 0;
    const bool across = beyond & (length < radius) & (length + radius < kThin_m);
    const double side = across ? -1.0 : 1.0;
    const double scale = length < kOnAxis_m ? 0.0 : side / std::max(length, kOnAxis_m);
    return {side * length - radius, t, {scale * from_ray[0], scale * from_ray[1], scale * from_ray[2]}};
}

}  // namespace kinevox::kernels
