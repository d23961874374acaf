#include "server/pose/turned_posture.h"

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

// Half a turn of a limb about the line from its first joint to its last, hip to ankle or shoulder to wrist:
// both stay, and knee or elbow bends to the other side.
Mat3 limb_rotation(const PosedBody& posed, int upper, int end) {
    const Vec3 along =
        posed.world_from_segment[end].translation - posed.world_from_segment[upper].translation;
    const double length = norm(along);
    const Vec3 axis =
        length > 1e-3 ? along / length : posed.world_from_segment[upper].rotation * Vec3{0, 0, 1};
    return rotation_from_rodrigues(std::numbers::pi * axis);
}

}  // namespace

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

BodyPosture elbow_mirrored(const BodyModel& model, const BodyPosture& posture, int upper_arm) {
    const PosedBody posed = model.forward(posture);
    const int hand = upper_arm == kUpperArmL ? kHandL : kHandR;
    BodyPosture out = posture;
    out.parent_from_segment[upper_arm] =
        posed.world_from_segment[kBodyParent[upper_arm]].rotation.transposed() *
        limb_rotation(posed, upper_arm, hand) * posed.world_from_segment[upper_arm].rotation;
    out.parent_from_segment[hand] = Mat3{};
    return out;
}

double upper_arm_twist(const BodyPosture& posture, int upper_arm) {
    const Quaternion q = quaternion_from_rotation(posture.parent_from_segment[upper_arm]);
    return std::remainder(2 * std::atan2(q.z, q.w), 2 * std::numbers::pi);
}

}  // namespace kinevox
