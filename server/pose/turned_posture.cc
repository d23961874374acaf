#include "server/pose/turned_posture.h"

#include <array>
#include <numbers>

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

// Half a turn of a leg about the line from hip to ankle: both stay, and the knee bends to the other side.
Mat3 leg_rotation(const PosedBody& posed, int thigh, int foot) {
    const Vec3 along =
        posed.world_from_segment[foot].translation - posed.world_from_segment[thigh].translation;
    const double length = norm(along);
    const Vec3 axis =
        length > 1e-3 ? along / length : posed.world_from_segment[thigh].rotation * Vec3{0, 0, 1};
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
            world_from_segment[s] = leg_rotation(posed, from, from == kThighL ? kFootL : kFootR) * there;
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

}  // namespace kinevox
