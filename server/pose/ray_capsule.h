// Viewing rays and tapered capsules: which capsule a silhouette's border touches, and where.
#pragma once

#include <span>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/silhouette_rays.h"

namespace kinevox {

// For each ray the capsule that decides its signed distance to the body (negative: the ray goes through it),
// or -1. A capsule whose axis lies on the outer side of the border counts only if the ray goes through it.
void nearest_capsules(const ContourRays& rays, std::span<const BodyCapsule> capsules,
                      std::vector<float>& distance, std::vector<int>& capsule);

struct RayTouch {
    bool usable = false;
    double distance = 0;  // m, signed
    double along = 0;     // on the capsule's axis, 0..1
    Vec3 point;           // there
    Vec3 gradient;        // d distance / d point
};

// Exact for one ray. Where a thin capsule's axis lies beyond the border, the distance is that by which it
// must come to the other side.
RayTouch touch_ray(Vec3 origin, Vec3 direction, Vec3 outward, const BodyCapsule& capsule);

}  // namespace kinevox
