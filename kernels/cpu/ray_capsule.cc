#include "kernels/ray_capsule.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>

#include "kernels/cpu/dispatch.h"
#include "kernels/ray_touch.h"

// Plain loops over a block of rays, which the compiler vectorises for each family that Highway chooses from.
#ifdef KINEVOX_HAVE_HIGHWAY
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/cpu/ray_capsule.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
HWY_BEFORE_NAMESPACE();
#endif

namespace kinevox::kernels::HWY_NAMESPACE {

constexpr int kBlock = 16;  // rays

// A capsule as seen from the rays' origin.
struct SeenCapsule {
    float a[3], e[3];          // one end of the axis, and from there to the other
    float ee, ea, aa;          // their products
    float radius_a, taper;     // m; m along the whole axis
    float centre[3], centre2;  // of the ball around all of it, and its squared distance
    float ball_radius;         // the ball's radius
};

struct RayBlock {
    float dx[kBlock], dy[kBlock], dz[kBlock], nx[kBlock], ny[kBlock], nz[kBlock];
    float best[kBlock];
    int which[kBlock];
};

inline SeenCapsule seen_from(const float* origin, const TaperedCapsule& c) {
    SeenCapsule s;
    const auto dot = [](const float* u, const float* v) { return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]; };
    for (int axis = 0; axis < 3; ++axis) {
        s.a[axis] = c.a[axis] - origin[axis];
        s.e[axis] = c.b[axis] - c.a[axis];
        s.centre[axis] = s.a[axis] + 0.5f * s.e[axis];
    }
    s.ee = dot(s.e, s.e), s.ea = dot(s.e, s.a), s.aa = dot(s.a, s.a);
    s.radius_a = c.radius_a, s.taper = c.radius_b - c.radius_a;
    s.centre2 = dot(s.centre, s.centre);
    s.ball_radius = 0.5f * std::sqrt(s.ee) + std::max(c.radius_a, c.radius_b);
    return s;
}

// A margin for what floats lose.
constexpr float kMargin_m = 1e-3f, kMargin2 = 1e-4f;

// The balls around capsules, for all capsules at once; those that do not exist are infinitely far.
constexpr int kLanes = 16;
struct SeenBalls {
    float x[kMaxCapsules], y[kMaxCapsules], z[kMaxCapsules];
    float distance2[kMaxCapsules], radius[kMaxCapsules];
};

inline void add_ball(SeenBalls& balls, int k, const SeenCapsule& c) {
    balls.x[k] = c.centre[0], balls.y[k] = c.centre[1], balls.z[k] = c.centre[2];
    balls.distance2[k] = c.centre2;
    balls.radius[k] = c.ball_radius + kMargin_m;
}

// Marks the capsules whose balls are for one of the rays nearer than what was found.
inline void find_near(const RayBlock& rays, const SeenBalls& balls, int count, std::int32_t* is_near) {
    std::fill_n(is_near, kMaxCapsules, 0);
    for (int i = 0; i < kBlock; ++i) {
        const float dx = rays.dx[i], dy = rays.dy[i], dz = rays.dz[i], best = rays.best[i];
        for (int first = 0; first < count; first += kLanes)
            for (int k = first; k < first + kLanes; ++k) {
                const float along = dx * balls.x[k] + dy * balls.y[k] + dz * balls.z[k];
                const float within = best + balls.radius[k];
                is_near[k] |=
                    (within > 0.f) & (balls.distance2[k] - along * along < within * within + kMargin2);
            }
    }
}

// False if the ball around the capsule is for no ray nearer than what was found.
inline bool is_nearest(const RayBlock& rays, const SeenCapsule& c) {
    int any = 0;
    for (int i = 0; i < kBlock; ++i) {
        const float along = rays.dx[i] * c.centre[0] + rays.dy[i] * c.centre[1] + rays.dz[i] * c.centre[2];
        const float within = rays.best[i] + c.ball_radius + kMargin_m;
        any |= (within > 0.f) & (c.centre2 - along * along < within * within + kMargin2);
    }
    return any != 0;
}

// The axis' point at t lies sqrt(q2 t^2 + 2 q1 t + q0) from the ray. Without taper the nearest is where that
// is least; with it the nearest moves on towards the thicker end, until the surface's slope is met.
inline void meet(RayBlock& rays, const SeenCapsule& c, int index) {
    for (int i = 0; i < kBlock; ++i) {
        const float de = rays.dx[i] * c.e[0] + rays.dy[i] * c.e[1] + rays.dz[i] * c.e[2];
        const float da = rays.dx[i] * c.a[0] + rays.dy[i] * c.a[1] + rays.dz[i] * c.a[2];
        const float q2 = c.ee - de * de + 1e-9f, q1 = c.ea - de * da, q0 = c.aa - da * da;
        const float per_q2 = 1 / q2;
        float t = -q1 * per_q2;
        const float h2 = std::max(q0 + q1 * t, 0.f);
        const float slope = c.taper * c.taper * per_q2;
        t += c.taper * per_q2 * std::sqrt(h2 / std::max(1 - slope, 0.05f));
        t = std::min(std::max(t, 0.f), 1.f);
        const float d = std::sqrt(std::max(q0 + t * (2 * q1 + q2 * t), 0.f)) - (c.radius_a + c.taper * t);
        const float side = rays.nx[i] * (c.a[0] + t * c.e[0]) + rays.ny[i] * (c.a[1] + t * c.e[1]) +
                           rays.nz[i] * (c.a[2] + t * c.e[2]);
        const float rank = ((d > 0.f) & (side > 0.f)) ? kWrongSide_m : d;
        // As if the capsules came in their order: of equal ones the first.
        const bool nearer = (rank < rays.best[i]) | ((rank == rays.best[i]) & (index < rays.which[i]));
        rays.which[i] = nearer ? index : rays.which[i];
        rays.best[i] = nearer ? rank : rays.best[i];
    }
}

// `known`: distance_m holds those of other capsules.
void nearest_capsules(const RayBundle& rays, std::span<const TaperedCapsule> capsules, bool known,
                      float* distance_m, int* nearest) {
    SeenCapsule seen[kMaxCapsules];
    SeenBalls balls;
    std::int32_t is_near[kMaxCapsules];
    const int count = static_cast<int>(capsules.size());
    for (int k = 0; k < count; ++k) {
        seen[k] = seen_from(rays.origin, capsules[k]);
        add_ball(balls, k, seen[k]);
    }
    for (int k = count; k % kLanes != 0; ++k)
        balls.x[k] = balls.y[k] = balls.z[k] = balls.radius[k] = 0, balls.distance2[k] = 1e30f;
    RayBlock block{};
    // Neighbours on the border are near the same capsules: those of the block before come first, so that
    // all farther ones are seen to be farther.
    int likely[kBlock], likely_count = 0;
    for (int first = 0; first < rays.count; first += kBlock) {
        const int size = std::min(kBlock, rays.count - first);
        const auto load = [&](const float* from, float* to) {
            if (size == kBlock) {  // of a known size it is one instruction
                std::memcpy(to, from + first, sizeof(float) * kBlock);
                return;
            }
            std::memcpy(to, from + first, sizeof(float) * static_cast<std::size_t>(size));
            std::fill(to + size, to + kBlock, to[size - 1]);
        };
        load(rays.direction[0], block.dx), load(rays.direction[1], block.dy),
            load(rays.direction[2], block.dz);
        load(rays.outward[0], block.nx), load(rays.outward[1], block.ny), load(rays.outward[2], block.nz);
        std::fill_n(block.best, kBlock, kWrongSide_m);
        if (known) load(distance_m, block.best);
        std::fill_n(block.which, kBlock, -1);
        for (int n = 0; n < likely_count; ++n)
            if (const int k = likely[n]; is_nearest(block, seen[k])) meet(block, seen[k], k);
        find_near(block, balls, count, is_near);
        for (int n = 0; n < likely_count; ++n) is_near[likely[n]] = 0;
        for (int k = 0; k < count; ++k)
            if (is_near[k] && is_nearest(block, seen[k])) meet(block, seen[k], k);
        likely_count = 0;
        for (int i = 0; i < size; ++i)
            if (const int k = block.which[i];
                k >= 0 && std::find(likely, likely + likely_count, k) == likely + likely_count)
                likely[likely_count++] = k;
        std::copy_n(block.best, size, distance_m + first);
        std::copy_n(block.which, size, nearest + first);
    }
}

void touch_capsules(const RayBundle& rays, const double* from, std::span<const TaperedCapsule> capsules,
                    const int* which, const RayTouches& out) {
    const double origin[3] = {from[0], from[1], from[2]};
    float ends[8][kMaxCapsules];
    for (std::size_t k = 0; k < capsules.size(); ++k) {
        for (int axis = 0; axis < 3; ++axis)
            ends[axis][k] = capsules[k].a[axis], ends[4 + axis][k] = capsules[k].b[axis];
        ends[3][k] = capsules[k].radius_a, ends[7][k] = capsules[k].radius_b;
    }
    const float *const dx = rays.direction[0], *const dy = rays.direction[1], *const dz = rays.direction[2];
    const float *const nx = rays.outward[0], *const ny = rays.outward[1], *const nz = rays.outward[2];
    double *const gx = out.gradient[0], *const gy = out.gradient[1], *const gz = out.gradient[2];
    double *const distance = out.distance_m, *const along = out.along;
#pragma GCC ivdep
    for (int i = 0; i < rays.count; ++i) {
        const std::int32_t k = std::max(which[i], 0);
        const float a[3] = {ends[0][k], ends[1][k], ends[2][k]}, b[3] = {ends[4][k], ends[5][k], ends[6][k]};
        const double direction[3] = {dx[i], dy[i], dz[i]}, outward[3] = {nx[i], ny[i], nz[i]};
        const RayTouch touch = touch_capsule(direction, outward, origin, a, b, ends[3][k], ends[7][k]);
        gx[i] = touch.gradient[0], gy[i] = touch.gradient[1], gz[i] = touch.gradient[2];
        distance[i] = touch.distance_m;
        along[i] = touch.along;
    }
}

}  // namespace kinevox::kernels::HWY_NAMESPACE

#ifdef KINEVOX_HAVE_HIGHWAY
HWY_AFTER_NAMESPACE();
#endif

#if !defined(KINEVOX_HAVE_HIGHWAY) || HWY_ONCE
namespace kinevox::kernels {

KINEVOX_EXPORT(nearest_capsules);
KINEVOX_EXPORT(touch_capsules);

namespace {

void check_count(std::span<const TaperedCapsule> capsules) {
    if (capsules.size() > kMaxCapsules)
        throw std::invalid_argument("rays and capsules: " + std::to_string(capsules.size()) +
                                    " capsules; at most " + std::to_string(kMaxCapsules));
}

}  // namespace

void nearest_capsules(const RayBundle& rays, std::span<const TaperedCapsule> capsules, float* distance_m,
                      int* nearest) {
    check_count(capsules);
    KINEVOX_DISPATCH(nearest_capsules)(rays, capsules, false, distance_m, nearest);
}

void nearer_capsules(const RayBundle& rays, std::span<const TaperedCapsule> capsules, float* distance_m,
                     int* nearest) {
    check_count(capsules);
    KINEVOX_DISPATCH(nearest_capsules)(rays, capsules, true, distance_m, nearest);
}

void touch_capsules(const RayBundle& rays, const double* origin, std::span<const TaperedCapsule> capsules,
                    const int* which, const RayTouches& out) {
    check_count(capsules);
    KINEVOX_DISPATCH(touch_capsules)(rays, origin, capsules, which, out);
}

}  // namespace kinevox::kernels
#endif
