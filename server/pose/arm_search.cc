#include "server/pose/arm_search.h"

#include <algorithm>
#include <iterator>

#include "server/pose/turned_posture.h"

namespace kinevox {
namespace {

std::vector<BodyCapsule> capsules_of(const BodyModel& model, const BodyPosture& posture) {
    std::vector<BodyCapsule> capsules;
    model.capsules(model.forward(posture), capsules);
    return capsules;
}

}  // namespace

ArmSearch::ArmSearch(const BodyModel& model, const BodyPosture& posture, int forearm,
                     std::span<const SilhouetteRays> views, const BodyColours& colours, double robust_m,
                     PoseCost& cost)
    : model_(model),
      forearm_(forearm),
      views_(views),
      robust_m_(robust_m),
      cost_(cost),
      capsules_(capsules_of(model, posture)),
      colour_(colours, views, [this] {
          std::erase_if(capsules_, [this](const BodyCapsule& c) { return moves(c); });
          return std::span<const BodyCapsule>(capsules_);
      }()) {
    best_ = judge(posture);
    before_ = best_.total();
}

bool ArmSearch::moves(const BodyCapsule& capsule) const {
    return capsule.segment == kBodyParent[forearm_] || capsule.segment == forearm_ ||
           kBodyParent[capsule.segment] == forearm_;
}

MovedArm ArmSearch::judge(const BodyPosture& posture) {
    const double cost = cost_.cost_of(model_, posture, views_, robust_m_);
    capsules_.clear();
    std::ranges::copy_if(cost_.capsules(), std::back_inserter(capsules_),
                         [this](const BodyCapsule& c) { return moves(c); });
    return {posture, cost, colour_.cost(capsules_)};
}

std::array<MovedArm, 6> ArmSearch::around(double angle) {
    const auto turned = [&](double twist, double bend) {
        return judge(forearm_moved(best_.posture, forearm_, twist, bend));
    };
    const auto swivelled = [&](double by) {
        return judge(elbow_swivelled(model_, best_.posture, kBodyParent[forearm_], by));
    };
    return {turned(angle, 0),  turned(-angle, 0), turned(0, angle),
            turned(0, -angle), swivelled(angle),  swivelled(-angle)};
}

void ArmSearch::improve(std::span<const double> angles, int max_moves) {
    for (const double angle : angles)
        for (int n = 0; n < max_moves; ++n) {
            std::array<MovedArm, 6> tried = around(angle);
            const MovedArm& cheapest = *std::ranges::min_element(tried, {}, &MovedArm::total);
            if (cheapest.total() >= best_.total()) break;
            best_ = cheapest;
        }
}

}  // namespace kinevox
