#include "server/pose/turned_posture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "common/body_pose.h"
#include "common/geometry.h"

namespace kinevox {
namespace {

// The segment of the other side; of the trunk itself.
constexpr std::array<int, kBodySegmentCount> make_other_side() {
    std::array<int, kBodySegmentCount> other{};
    for (int s = 0; s < kBodySegmentCount; ++s) other[s] = s;
    for (const LimbSegmentPairs& pairs : {kLegSegments, kArmSegments})
        for (const auto& [left, right] : pairs) other[left] = right, other[right] = left;
    return other;
}
constexpr std::array<int, kBodySegmentCount> kOtherSide = make_other_side();

// Rotation of a limb about the line from its first joint to its last, hip to ankle or shoulder to wrist: both
// stay. By half a turn, knee or elbow bends to the other side.
Mat3 limb_rotation(const PosedBody& posed, int upper, int end, double angle = std::numbers::pi) {
    const Vec3 along =
        posed.world_from_segment[end].translation - posed.world_from_segment[upper].translation;
    const double length = norm(along);
    const Vec3 axis =
        length > 1e-3 ? along / length : posed.world_from_segment[upper].rotation * Vec3{0, 0, 1};
    return rotation_from_rodrigues(angle * axis);
}

// parent_from_segment of a segment after a rotation in the world, its parent at rest.
Mat3 rotated_in_parent(const PosedBody& posed, int segment, const Mat3& rotation) {
    return posed.world_from_segment[kBodyParent[segment]].rotation.transposed() * rotation *
           posed.world_from_segment[segment].rotation;
}

// Rotates an upper arm about its own axis and bends its elbow so that the forearm has a direction in the
// world; the hand straight.
BodyPosture forearm_along(const BodyModel& model, BodyPosture posture, int forearm, Vec3 to) {
    const int upper_arm = kBodyParent[forearm], hand = forearm == kForearmL ? kHandL : kHandR;
    const PosedBody posed = model.forward(posture);
    const Vec3 elbow = posed.world_from_segment[forearm].translation;
    const Vec3 axis = normalized(elbow - posed.world_from_segment[upper_arm].translation);
    posture.parent_from_segment[hand] = Mat3{};
    posture.parent_from_segment[forearm] =
        rotation_from_rodrigues(std::acos(std::clamp(dot(axis, to), -1.0, 1.0)) * hinge_axis(forearm));
    // About the upper arm's axis from where the bent forearm points to where it must.
    const auto across = [&](Vec3 direction) { return direction - dot(direction, axis) * axis; };
    const Vec3 bent = across(model.forward(posture).world_from_segment[hand].translation - elbow),
               wanted = across(to);
    const double twist = std::atan2(dot(cross(bent, wanted), axis), dot(bent, wanted));
    posture.parent_from_segment[upper_arm] =
        rotated_in_parent(posed, upper_arm, rotation_from_rodrigues(twist * axis));
    return posture;
}

}  // namespace

BodyPosture exchanged(BodyPosture posture, const LimbSegmentPairs& limbs) {
    for (const auto& [left, right] : limbs)
        std::swap(posture.parent_from_segment[left], posture.parent_from_segment[right]);
    return posture;
}

BodyPosture turned(const BodyModel& model, const BodyPosture& posture) {
    const PosedBody posed = model.forward(posture);
    const Mat3 half_turn = rotation_z(std::numbers::pi);
    BodyPosture out;
    out.root_in_world = posture.root_in_world;
    std::array<Mat3, kBodySegmentCount> world_from_segment;
    for (int s = 0; s < kBodySegmentCount; ++s) {
        const int from = kOtherSide[s], parent = kBodyParent[s];
        if (kSegmentDofCount[s] == 1) {
            const Vec3 axis = hinge_axis(s);
            const double angle = dot(rodrigues_from_rotation(posture.parent_from_segment[from]), axis);
            out.parent_from_segment[s] = rotation_from_rodrigues(angle * axis);
            world_from_segment[s] = world_from_segment[parent] * out.parent_from_segment[s];
            continue;
        }
        const Mat3& there = posed.world_from_segment[from].rotation;
        if (s == kThighL || s == kThighR)
            world_from_segment[s] = limb_rotation(posed, from, from == kThighL ? kFootL : kFootR) * there;
        else if (s == kUpperArmL || s == kUpperArmR)
            world_from_segment[s] = there;
        else
            world_from_segment[s] = there * half_turn;
        out.parent_from_segment[s] = parent < 0
                                         ? world_from_segment[s]
                                         : world_from_segment[parent].transposed() * world_from_segment[s];
    }
    return out;
}

BodyPosture elbow_swivelled(const BodyModel& model, const BodyPosture& posture, int upper_arm, double angle) {
    const PosedBody posed = model.forward(posture);
    const int hand = upper_arm == kUpperArmL ? kHandL : kHandR;
    BodyPosture out = posture;
    out.parent_from_segment[upper_arm] =
        rotated_in_parent(posed, upper_arm, limb_rotation(posed, upper_arm, hand, angle));
    return out;
}

BodyPosture elbow_mirrored(const BodyModel& model, const BodyPosture& posture, int upper_arm) {
    BodyPosture out = elbow_swivelled(model, posture, upper_arm, std::numbers::pi);
    out.parent_from_segment[upper_arm == kUpperArmL ? kHandL : kHandR] = Mat3{};
    return out;
}

std::optional<BodyPosture> forearm_turned(const BodyModel& model, const BodyPosture& posture, int forearm,
                                          Vec3 viewpoint, double angle) {
    const int hand = forearm == kForearmL ? kHandL : kHandR;
    const PosedBody posed = model.forward(posture);
    const Vec3 elbow = posed.world_from_segment[forearm].translation;
    const Vec3 now = normalized(posed.world_from_segment[hand].translation - elbow);
    const Vec3 away = normalized(elbow - viewpoint);
    const Vec3 in_image = now - dot(now, away) * away;
    const double depth_angle = std::atan2(dot(now, away), norm(in_image)) + angle;
    if (std::abs(depth_angle) > std::numbers::pi / 2 || norm(in_image) < 1e-3) return std::nullopt;
    const Vec3 to = std::cos(depth_angle) * normalized(in_image) + std::sin(depth_angle) * away;
    return forearm_along(model, posture, forearm, to);
}

BodyPosture forearm_moved(BodyPosture posture, int forearm, double twist, double bend) {
    constexpr double kMaxBend_rad = 2.6;
    const Vec3 axis = hinge_axis(forearm);
    const double bent = dot(rodrigues_from_rotation(posture.parent_from_segment[forearm]), axis);
    Mat3& upper_arm = posture.parent_from_segment[kBodyParent[forearm]];
    upper_arm = upper_arm * rotation_z(twist);
    posture.parent_from_segment[forearm] =
        rotation_from_rodrigues(std::clamp(bent + bend, 0.0, kMaxBend_rad) * axis);
    return posture;
}

double upper_arm_twist(const BodyPosture& posture, int upper_arm) {
    const Quaternion q = quaternion_from_rotation(posture.parent_from_segment[upper_arm]);
    return std::remainder(2 * std::atan2(q.z, q.w), 2 * std::numbers::pi);
}

}  // namespace kinevox
