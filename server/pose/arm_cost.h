// The cost of postures that differ in one arm alone: what the rest of the body costs is computed once.
#pragma once

#include <span>
#include <vector>

#include "server/pose/limb_search.h"
#include "server/pose/pose_cost.h"
#include "server/pose/ray_capsule.h"

namespace kinevox {

// Model and views must outlive it. Not thread-safe.
class ArmCost {
  public:
    // `posture` as all that are compared, but for the arm. `robust_m` as in PoseCost.
    ArmCost(const PoseCostOptions& options, const BodyModel& model, const BodyPosture& posture,
            const LimbSegments& arm, std::span<const SilhouetteRays> views, double robust_m);

    // PoseCost::cost_of() less the same number for all postures.
    double cost_of(const BodyPosture& posture);
    // Of the arm in the last posture, and of the rest of the body.
    std::span<const BodyCapsule> arm() const { return moved_; }
    std::span<const BodyCapsule> rest() const { return rest_; }

  private:
    // What the contour's rays of a view cost without the arm.
    struct RestOfView {
        std::vector<float> ranks;   // see NearestCapsules
        std::vector<double> costs;  // of each ray
    };
    double contour_change(const SilhouetteRays& view, const RestOfView& without);

    const BodyModel& model_;
    LimbSegments segments_;
    std::span<const SilhouetteRays> views_;
    double robust_m_;
    Rigid3 world_from_trunk_;
    std::vector<BodyCapsule> rest_, moved_;
    std::vector<RestOfView> without_;  // per view
    PoseCost cost_;
    NearerCapsules nearer_;
};

}  // namespace kinevox
