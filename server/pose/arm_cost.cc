#include "server/pose/arm_cost.h"

#include <optional>

namespace kinevox {

ArmCost::ArmCost(const PoseCostOptions& options, const BodyModel& model, const BodyPosture& posture,
                 const LimbSegments& arm, std::span<const SilhouetteRays> views, double robust_m)
    : model_(model), segments_(arm), views_(views), robust_m_(robust_m), cost_(options) {
    const PosedBody posed = model.forward(posture);
    world_from_trunk_ = posed.world_from_segment[kBodyParent[arm.upper]];
    model.capsules(posed, rest_);
    std::erase_if(rest_, [&](const BodyCapsule& c) { return arm.has(c.segment); });
    without_.resize(views.size());
    NearestCapsules nearest;
    for (std::size_t c = 0; c < views.size(); ++c) {
        if (!views[c].camera) continue;
        nearest.find(views[c].contour, rest_);
        RestOfView& without = without_[c];
        without.ranks.assign(nearest.ranks().begin(), nearest.ranks().end());
        for (std::size_t i = 0; i < without.ranks.size(); ++i) {
            const RayTouch touch = nearest.capsule(i) < 0 ? RayTouch{} : nearest.touch(i);
            without.costs.push_back(touch.usable ? cost_.contour_cost(touch.distance, robust_m) : 0);
        }
    }
}

double ArmCost::contour_change(const SilhouetteRays& view, const RestOfView& without) {
    nearer_.find(view.contour, without.ranks, moved_);
    double change = 0;
    for (std::size_t n = 0; n < nearer_.rays().size(); ++n) {
        const std::optional<double> distance_m = nearer_.distance_m(n);
        change +=
            (distance_m ? cost_.contour_cost(*distance_m, robust_m_) : 0) - without.costs[nearer_.rays()[n]];
    }
    return change;
}

double ArmCost::cost_of(const BodyPosture& posture) {
    const auto& rotations = posture.parent_from_segment;
    moved_.clear();
    append_capsules(model_, world_from_trunk_, segments_,
                    {rotations[segments_.upper], rotations[segments_.lower], rotations[segments_.end]},
                    moved_);
    double cost = cost_.cost_beside(moved_, rest_, views_, robust_m_);
    for (std::size_t c = 0; c < views_.size(); ++c)
        if (views_[c].camera) cost += contour_change(views_[c], without_[c]);
    for (const int segment : {segments_.upper, segments_.lower, segments_.end})
        cost += angle_cost(posture, segment);
    return cost;
}

}  // namespace kinevox
