#include "server/pose/ray_capsule.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace kinevox {
namespace {

constexpr float kWrongSide = 1e3f;     // added to the distance of a capsule on the outer side
constexpr float kThin_m = 0.09f;       // a capsule is drawn over the border if it need not move farther

}  // namespace

// Branchless and in floats, so that the compiler makes vectors of it: this is the fit's innermost loop.
void nearest_capsules(const ContourRays& rays, std::span<const BodyCapsule> capsules, std::vector<float>& distance,
                      std::vector<int>& capsule) {
    const std::size_t n = rays.size();
    distance.assign(n, kWrongSide);
    capsule.assign(n, -1);
    const float *dx = rays.direction[0].data(), *dy = rays.direction[1].data(), *dz = rays.direction[2].data();
    const float *nx = rays.outward[0].data(), *ny = rays.outward[1].data(), *nz = rays.outward[2].data();
    float* best = distance.data();
    int* which = capsule.data();
    for (std::size_t k = 0; k < capsules.size(); ++k) {
        const BodyCapsule& c = capsules[k];
        const float ax = c.a[0] - static_cast<float>(rays.origin_in_world.x),
                    ay = c.a[1] - static_cast<float>(rays.origin_in_world.y),
                    az = c.a[2] - static_cast<float>(rays.origin_in_world.z);
        const float ex = c.b[0] - c.a[0], ey = c.b[1] - c.a[1], ez = c.b[2] - c.a[2];
        const float ee = ex * ex + ey * ey + ez * ez, ea = ex * ax + ey * ay + ez * az, aa = ax * ax + ay * ay + az * az;
        const float ra = c.radius_a, dr = c.radius_b - c.radius_a;
        const int index = static_cast<int>(k);
        for (std::size_t i = 0; i < n; ++i) {
            const float de = dx[i] * ex + dy[i] * ey + dz[i] * ez, da = dx[i] * ax + dy[i] * ay + dz[i] * az;
            // Squared distance of the axis' point from the ray: q2 t^2 + 2 q1 t + q0.
            const float q2 = ee - de * de + 1e-9f, q1 = ea - de * da, q0 = aa - da * da;
            float t = -q1 / q2;
            const float h2 = std::max(q0 + q1 * t, 0.f);
            const float taper = dr * dr / q2;
            t += dr * std::sqrt(h2) / (q2 * std::sqrt(std::max(1 - taper, 0.05f)));
            t = std::min(std::max(t, 0.f), 1.f);
            const float d = std::sqrt(std::max(q0 + t * (2 * q1 + q2 * t), 0.f)) - (ra + dr * t);
            const float side = nx[i] * (ax + t * ex) + ny[i] * (ay + t * ey) + nz[i] * (az + t * ez);
            const float rank = (d > 0.f && side > 0.f) ? d + kWrongSide : d;
            which[i] = rank < best[i] ? index : which[i];
            best[i] = std::min(rank, best[i]);
        }
    }
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
