// The nearest capsule of a body to each viewing ray. The innermost loop of fitting a pose to contours.
#pragma once

#include <span>

#include "kernels/body_silhouette.h"

namespace kinevox::kernels {

// Rays of one origin through a silhouette's border.
struct RayBundle {
    float origin[3] = {0, 0, 0};                              // m, world
    const float* direction[3] = {nullptr, nullptr, nullptr};  // x, y, z of `count` unit vectors, world
    const float* outward[3] = {nullptr, nullptr, nullptr};    // normal to the ray, away from the silhouette
    int count = 0;
};

inline constexpr int kMaxCapsules = 64;
inline constexpr float kWrongSide_m = 1e3f;

// For each ray the capsule with the smallest signed distance to it, m (negative: the ray goes through it),
// and that distance. A capsule whose axis lies on the outer side of the border counts only if the ray goes
// through it. Where none counts, -1 and kWrongSide_m. `distance_m` and `nearest` have room for all rays.
// Throws std::invalid_argument for more than kMaxCapsules.
void nearest_capsules(const RayBundle& rays, std::span<const TaperedCapsule> capsules, float* distance_m,
                      int* nearest);

// The same where each ray has a nearest capsule already, at `distance_m`, which is not among these: -1 in
// `nearest` and its distance stay where none of these is nearer.
void nearer_capsules(const RayBundle& rays, std::span<const TaperedCapsule> capsules, float* distance_m,
                     int* nearest);

// Where rays touch capsules; arrays with an element per ray.
struct RayTouches {
    double* distance_m = nullptr;  // signed, negative: the ray goes through the capsule
    double* along = nullptr;       // on the capsule's axis, from a (0) to b (1)
    double* gradient[3] = {};      // d distance / d point there, length 1; 0: the ray meets the axis
};

// The exact distance of each ray to the capsule which[ray]. If a thin one's axis is outside the border, that
// to its other side. A negative `which` is as 0; `origin` is more exact than that of `rays`.
void touch_capsules(const RayBundle& rays, const double* origin, std::span<const TaperedCapsule> capsules,
                    const int* which, const RayTouches& out);

}  // namespace kinevox::kernels
