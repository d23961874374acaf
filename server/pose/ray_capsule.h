// Distance of viewing rays to tapered capsules: the capsule that a silhouette's border touches, and the
// point.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "kernels/ray_capsule.h"
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

// Of a ray to the ball around a capsule; negative inside. No point of the capsule is nearer.
double distance_to_ball_m(Vec3 origin, Vec3 direction, const BodyCapsule& capsule);

// For each ray the nearest capsule and where the ray touches it. Keeps its memory.
class NearestCapsules {
  public:
    void find(const ContourRays& rays, std::span<const BodyCapsule> capsules);
    int capsule(std::size_t ray) const { return capsule_[ray]; }  // -1: none
    RayTouch touch(std::size_t ray) const;                        // of that one

    // Its distance as nearest_capsules() compares it.
    std::span<const float> ranks() const { return rank_; }

  private:
    std::vector<kernels::TaperedCapsule> capsules_;
    std::vector<float> rank_;
    std::vector<int> capsule_;
    std::vector<double> distance_, along_;
    std::array<std::vector<double>, 3> gradient_;
};

// The rays to which capsules come nearer than what is there already, and how near. Keeps its memory.
class NearerCapsules {
  public:
    // `ranks`: NearestCapsules::ranks() of the same rays.
    void find(const ContourRays& rays, std::span<const float> ranks, std::span<const BodyCapsule> capsules);
    std::span<const int> rays() const { return rays_; }
    // Of rays()[n], signed; empty if the ray meets the axis.
    std::optional<double> distance_m(std::size_t n) const;

  private:
    std::vector<kernels::TaperedCapsule> capsules_;
    std::vector<float> rank_;
    std::vector<int> capsule_, rays_, capsule_of_ray_;
    std::array<std::vector<float>, 6> gathered_;  // direction and outward normal of rays()
    std::vector<double> distance_, along_;
    std::array<std::vector<double>, 3> gradient_;
};

}  // namespace kinevox
