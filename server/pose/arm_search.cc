#include "server/pose/arm_search.h"

#include <algorithm>

#include "server/pose/turned_posture.h"

namespace kinevox {
ArmSearch::ArmSearch(const BodyModel& model, const BodyPosture& posture, Limb arm,
                     std::span<const SilhouetteRays> views, const BodyColours& colours,
                     const PoseFitOptions& options)
    : model_(model),
      which_(arm),
      arm_(segments_of(arm)),
      views_(views),
      robust_m_(options.narrow_m),
      cost_(options.cost, model, posture, arm_, views, robust_m_),
      colour_(colours, views, cost_.rest()),
      best_(judge(posture)),
      before_(best_.total()) {}

MovedArm ArmSearch::judge(const BodyPosture& posture) {
    const double cost = cost_.cost_of(posture);
    return {posture, cost, colour_.cost(cost_.arm())};
}

std::array<MovedArm, 6> ArmSearch::around(const BodyPosture& posture, double angle) {
    const auto turned = [&](double twist, double bend) {
        return judge(forearm_moved(posture, arm_.lower, twist, bend));
    };
    const auto swivelled = [&](double by) { return judge(elbow_swivelled(model_, posture, arm_.upper, by)); };
    return {turned(angle, 0),  turned(-angle, 0), turned(0, angle),
            turned(0, -angle), swivelled(angle),  swivelled(-angle)};
}

MovedArm ArmSearch::descended(MovedArm from, std::span<const double> angles, int max_moves) {
    for (const double angle : angles)
        for (int n = 0; n < max_moves; ++n) {
            std::array<MovedArm, 6> tried = around(from.posture, angle);
            const MovedArm& cheapest = *std::ranges::min_element(tried, {}, &MovedArm::total);
            if (cheapest.total() >= from.total()) break;
            from = cheapest;
        }
    return from;
}

void ArmSearch::improve(std::span<const double> angles, int max_moves) {
    best_ = descended(best_, angles, max_moves);
}

void ArmSearch::improve_anywhere(LimbSearch& limbs, std::span<const double> angles, int max_moves,
                                 std::size_t max_starts) {
    std::vector<MovedArm> starts;
    for (const BodyPosture& start : limbs.plausible(model_, best_.posture, views_, which_, 2 * robust_m_))
        starts.push_back(judge(start));
    if (starts.size() > max_starts) {
        std::ranges::stable_sort(starts, {}, &MovedArm::total);
        starts.resize(max_starts);
    }
    for (const MovedArm& start : starts) {
        const MovedArm moved = descended(start, angles, max_moves);
        if (moved.total() < best_.total()) best_ = moved;
    }
}

}  // namespace kinevox
