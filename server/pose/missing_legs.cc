#include "server/pose/missing_legs.h"

#include <algorithm>
#include <cmath>

#include "common/body_pose.h"
#include "server/pose/each_run.h"

namespace kinevox {
namespace {

constexpr double kNearFloor_m = 0.25, kFolded = 0.5;

// Whether most cameras that have the point in their image see the subject there or beside it.
bool is_seen(Vec3 in_world, std::span<const SilhouetteRays> views) {
    constexpr double kBeside_m = 0.1;
    int seen = 0, missed = 0;
    for (const SilhouetteRays& view : views)
        if (const std::optional<double> inside_m = view.inside_m(in_world))
            ++(*inside_m > -kBeside_m ? seen : missed);
    return seen >= missed;
}

}  // namespace

LegSight see_legs(const BodyModel& model, const BodyPosture& posture, std::span<const SilhouetteRays> views) {
    const PosedBody posed = model.forward(posture);
    const auto& joints = posed.joints_in_world;
    const auto near_floor = [&](Vec3 joint) { return joint.z < kNearFloor_m && is_seen(joint, views); };
    const auto lacking = [&](std::size_t hip, std::size_t knee, std::size_t ankle, std::size_t toe) {
        const double leg = norm(joints[knee] - joints[hip]) + norm(joints[ankle] - joints[knee]);
        return (norm(joints[ankle] - joints[hip]) < kFolded * leg || joints[ankle].z > joints[hip].z ||
                !is_seen(joints[ankle], views)) &&
               !near_floor(joints[ankle]) && !near_floor(joints[toe]);
    };
    return {{lacking(*joint_index("hip_l"), *joint_index("knee_l"), *joint_index("ankle_l"),
                     *joint_index("toe_l")),
             lacking(*joint_index("hip_r"), *joint_index("knee_r"), *joint_index("ankle_r"),
                     *joint_index("toe_r"))},
            std::ranges::none_of(joints, near_floor)};
}

LegFlags MissingLegs::update(std::int64_t time_ns, const LegSight& sight) {
    const auto passed_s = [time_ns](std::int64_t since_ns) {
        return 1e-9 * static_cast<double>(time_ns - since_ns);
    };
    if (!seen_ns_ || !sight.none()) seen_ns_ = time_ns;
    if (passed_s(*seen_ns_) > kMaxJump_s) missing_ = {true, true};
    for (std::size_t leg = 0; leg < missing_.size(); ++leg) {
        std::optional<std::int64_t>& back_ns = back_ns_[leg];
        if (!missing_[leg] || sight.lacking[leg]) {
            back_ns.reset();
        } else if (!back_ns) {
            back_ns = time_ns;
        } else if (passed_s(*back_ns) > kMinLegSeen_s) {
            missing_[leg] = false;
        }
    }
    return missing_;
}

std::vector<LegFlags> missing_legs(std::span<const std::optional<LegSight>> sights,
                                   std::span<const double> time_s) {
    const std::size_t count = sights.size();
    const auto lasts = [&](std::size_t first, std::size_t end, double seconds) {
        return time_s[end - 1] - time_s[first] > seconds;
    };
    std::vector<char> none(count, 0);
    for (std::size_t n = 0; n < count; ++n) none[n] = sights[n] && sights[n]->none();
    each_run(
        count, [&](std::size_t n) { return sights[n] && !none[n]; },
        [&](std::size_t first, std::size_t end) {
            const bool between = first > 0 && none[first - 1] && end < count && none[end];
            if (between && !lasts(first, end, kMinLegSeen_s))
                std::fill(none.begin() + first, none.begin() + end, 1);
        });
    std::vector<LegFlags> missing(count);
    // From a body without legs on, forwards or backwards, until the leg is seen for long enough.
    const auto extend = [&](std::size_t from, int step, std::size_t leg) {
        std::size_t last = from;
        for (std::size_t n = from + step; n < count && sights[n]; n += step) {
            if (std::abs(time_s[n] - time_s[last]) > kMinLegSeen_s) break;
            if (!sights[n]->lacking[leg]) continue;
            for (; last != n; last += step) missing[last + step][leg] = true;
        }
    };
    each_run(
        count, [&](std::size_t n) { return none[n] != 0; },
        [&](std::size_t first, std::size_t end) {
            if (!lasts(first, end, kMaxJump_s)) return;
            std::fill(missing.begin() + first, missing.begin() + end, LegFlags{true, true});
            for (std::size_t leg = 0; leg < 2; ++leg) {
                extend(first, -1, leg);
                extend(end - 1, 1, leg);
            }
        });
    return missing;
}

}  // namespace kinevox
