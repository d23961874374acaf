#include "server/pose/ray_capsule.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "kernels/ray_capsule.h"

namespace kinevox {
namespace {

constexpr float kThin_m = 0.09f;  // maximum movement of a capsule across the border

}  // namespace

void nearest_capsules(const ContourRays& rays, std::span<const BodyCapsule> capsules,
                      std::vector<float>& distance, std::vector<int>& capsule) {
    std::array<kernels::TaperedCapsule, kernels::kMaxCapsules> plain;
    const std::size_t count = std::min(capsules.size(), plain.size());
    for (std::size_t k = 0; k < count; ++k) {
        const BodyCapsule& c = capsules[k];
        plain[k] = {{c.a[0], c.a[1], c.a[2]}, {c.b[0], c.b[1], c.b[2]}, c.radius_a, c.radius_b};
    }
    kernels::RayBundle bundle;
    bundle.origin[0] = static_cast<float>(rays.origin_in_world.x);
    bundle.origin[1] = static_cast<float>(rays.origin_in_world.y);
    bundle.origin[2] = static_cast<float>(rays.origin_in_world.z);
    for (int axis = 0; axis < 3; ++axis) {
        bundle.direction[axis] = rays.direction[axis].data();
        bundle.outward[axis] = rays.outward[axis].data();
    }
    bundle.count = static_cast<int>(rays.size());
    distance.resize(rays.size());
    capsule.resize(rays.size());
    kernels::nearest_capsules(bundle, std::span(plain.data(), count), distance.data(), capsule.data());
}

RayTouch touch_ray(Vec3 origin, Vec3 direction, Vec3 outward, const BodyCapsule& c) {
    const Vec3 a{c.a[0], c.a[1], c.a[2]}, e = Vec3{c.b[0], c.b[1], c.b[2]} - a, w = a - origin;
    const double de = dot(direction, e), da = dot(direction, w), dr = c.radius_b - c.radius_a;
    const double q2 = dot(e, e) - de * de + 1e-9, q1 = dot(e, w) - de * da, q0 = dot(w, w) - da * da;
    double t = -q1 / q2;
    const double h = std::sqrt(std::max(q0 + q1 * t, 0.0));
    t += dr * h / (q2 * std::sqrt(std::max(1 - dr * dr / q2, 0.05)));
    RayTouch touch;
    touch.along = t = std::clamp(t, 0.0, 1.0);
    touch.point = a + t * e;
    const Vec3 from_origin = touch.point - origin;
    const Vec3 from_ray = from_origin - dot(from_origin, direction) * direction;
    const double length = norm(from_ray), radius = c.radius_a + dr * t;
    if (length < 1e-9) return touch;
    touch.usable = true;
    touch.gradient = from_ray / length;
    touch.distance = length - radius;
    const bool beyond = dot(from_ray, outward) > 0;
    if (beyond && touch.distance < 0 && length + radius < kThin_m) {
        touch.gradient = -touch.gradient;
        touch.distance = -length - radius;
    }
    return touch;
}

}  // namespace kinevox
