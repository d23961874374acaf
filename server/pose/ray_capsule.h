// Distance of viewing rays to tapered capsules: the capsule that a silhouette's border touches, and the
// point.
#pragma once

#include <span>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/silhouette_rays.h"

namespace kinevox {

// For each ray the capsule with the smallest signed distance (negative: the ray passes through it), or -1. A
// capsule whose axis lies on the outer side of the border counts only if the ray goes through it.
void nearest_capsules(const ContourRays& rays, std::span<const BodyCapsule> capsules,
                      std::vector<float>& distance, std::vector<int>& capsule);

struct RayTouch {
    bool usable = false;
    double distance = 0;  // m, signed
    double along = 0;     // on the capsule's axis, 0..1
    Vec3 point;           // there
    Vec3 gradient;        // d distance / d point
};

// Exact for one ray. If a thin capsule's axis is outside the border, the distance is that to the other side.
RayTouch touch_ray(Vec3 origin, Vec3 direction, Vec3 outward, const BodyCapsule& capsule);

}  // namespace kinevox
