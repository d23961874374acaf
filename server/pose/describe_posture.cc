// The values of a posture and which of them are withheld; pose_estimate.cc states how certain they are.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string_view>

#include "common/body_pose.h"
#include "common/geometry.h"
#include "server/pose/pose_estimate.h"
#include "server/pose/turned_posture.h"

namespace kinevox {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kMinHipFlexion = 5 * kDegree;  // for a ratio

double ratio(double knee, double hip) {
    return std::abs(hip) < kMinHipFlexion ? kNaN : knee / hip;
}

void leave_rotation_open(int segment, BodyPose& out) {
    std::fill_n(out.coordinate_std.begin() + kSegmentDof[segment], kSegmentDofCount[segment],
                kRotationStd_rad);
}

}  // namespace

void describe_posture(const BodyModel& model, const BodyPosture& posture, BodyPose& out) {
    const PosedBody posed = model.forward(posture);
    for (std::size_t j = 0; j < out.joints.size(); ++j)
        out.joints[j].in_world = out.joints[j].measured() ? posed.joints_in_world[j] : Vec3{kNaN, kNaN, kNaN};
    const auto angles = joint_angles(posed.joints_in_world);
    for (std::size_t k = 0; k < out.angles.size(); ++k)
        out.angles[k].value_rad = out.angles[k].measured() ? angles[k] : kNaN;
    out.coordinates = coordinates_from_posture(posture);
    for (int s = 0; s < kBodySegmentCount; ++s) {
        out.world_from_segment[s] = quaternion_from_rotation(posed.world_from_segment[s].rotation);
        out.parent_from_segment[s] = quaternion_from_rotation(posture.parent_from_segment[s]);
    }
    out.ratios.knee_hip_flexion_ratio_l = ratio(out.angles[0].value_rad, out.angles[4].value_rad);
    out.ratios.knee_hip_flexion_ratio_r = ratio(out.angles[1].value_rad, out.angles[5].value_rad);
}

void withhold_legs(const LegFlags& missing, BodyPose& out) {
    static constexpr std::string_view kReason = "leg not in the silhouettes";
    constexpr std::size_t kWaist = *joint_index("sacroiliac");
    const bool both = missing[0] && missing[1];
    const auto of_missing_leg = [&](int segment) {
        return (both && segment == kPelvis) || std::ranges::any_of(kLegSegments, [&](const auto& pair) {
                   return (missing[0] && segment == pair.first) || (missing[1] && segment == pair.second);
               });
    };
    for (std::size_t j = 0; j < out.joints.size(); ++j)
        if (of_missing_leg(kJointSegment[j]) || (both && j == kWaist))
            out.joints[j].withheld_reason = kReason;
    for (std::size_t k = 0; k < out.angles.size(); ++k)
        if (of_missing_leg(kAngleSegments[k].first) || of_missing_leg(kAngleSegments[k].second))
            out.angles[k].withheld_reason = kReason;
    for (int s = 0; s < kBodySegmentCount; ++s)
        if (of_missing_leg(s)) leave_rotation_open(s, out);
    if (both) std::fill_n(out.coordinate_std.begin(), 3, kRoomStd_m);
}

void withhold_limbs(BodyPose& out) {
    static constexpr std::string_view kReason = "too little of the body visible beside others";
    for (std::size_t j = 0; j < out.joints.size(); ++j)
        if (kBodyParent[kJointSegment[j]] > kHead && out.joints[j].measured())
            out.joints[j].withheld_reason = kReason;
    for (std::size_t k = 0; k < out.angles.size(); ++k)
        if (kAngleSegments[k].second > kHead && out.angles[k].measured())
            out.angles[k].withheld_reason = kReason;
    for (int s = kHead + 1; s < kBodySegmentCount; ++s) leave_rotation_open(s, out);
}

void set_velocities(const BodyPose& before, BodyPose& pose) {
    const double seconds = 1e-9 * static_cast<double>(pose.capture_time_ns - before.capture_time_ns);
    if (!(seconds > 0)) return;
    for (std::size_t k = 0; k < pose.angles.size(); ++k)
        pose.angles[k].velocity_rad_per_s = (pose.angles[k].value_rad - before.angles[k].value_rad) / seconds;
    for (int d = 0; d < kBodyDofCount; ++d) {
        const double moved = pose.coordinates[d] - before.coordinates[d];
        pose.coordinate_velocity[d] =
            (is_position(d) ? moved : std::remainder(moved, 2 * std::numbers::pi)) / seconds;
    }
}

}  // namespace kinevox
