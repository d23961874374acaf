#include "server/pose/body_model.h"

#include <algorithm>

#include "server/pose/body_surface.h"

namespace kinevox {
namespace {

enum Joint : int {
    kRoot,
    kSacroiliac,
    kSkullbase,
    kHeadTop,
    kShoulderJointL,
    kElbowL,
    kWristL,
    kHandTipL,
    kHipL,
    kKneeL,
    kAnkleL,
    kToeL,
    kShoulderJointR,
    kElbowR,
    kWristR,
    kHandTipR,
    kHipR,
    kKneeR,
    kAnkleR,
    kToeR
};

// The neck is inclined forwards.
constexpr double kNeckForward = 0.03;

constexpr Vec3 kDown{0, 0, -1};

// Least squares over CMU motions on a skeleton with clavicles: row: shift forward, outward, up; column:
// direction of the upper arm; m for a body of 1.75 m. It leaves 2 to 4 mm of movements of 13 mm (Inman et al.
// 1944 describe the rhythm). The forward shift is corrected by the errors of fitted shoulders in nine
// sequences with truth, by half: some are the fits' own. How far a raised arm lifts the shoulder differs
// between persons: kShoulderRise.
constexpr double kRhythmStature = 1.75;
constexpr Mat3 kRhythm{{0.017, -0.021, 0.007, 0.005, 0.010, 0.001, 0.011, 0.011, 0}};

Vec3 mirrored(Vec3 v, bool left) {
    return left ? v : Vec3{v.x, -v.y, v.z};
}

}  // namespace

BodyCapsule capsule_in_world(const Rigid3& world_from_segment, BodyCapsule in_segment) {
    for (float* const end : {in_segment.a, in_segment.b}) {
        const Vec3 p = world_from_segment * Vec3{end[0], end[1], end[2]};
        end[0] = static_cast<float>(p.x), end[1] = static_cast<float>(p.y), end[2] = static_cast<float>(p.z);
    }
    return in_segment;
}

BodyModel::BodyModel(const BodyShape& shape) : shape_(shape), capsules_(body_surface(shape)) {
    const BodyShape& s = shape_;
    const double hips_x = -kHipsBehindRoot * s[kRootToSacroiliac],
                 hips_z = -kHipsBelowRoot * s[kRootToSacroiliac];
    offsets_[kPelvis] = {0, 0, 0};
    offsets_[kThorax] = {hips_x, 0, s[kRootToSacroiliac]};
    offsets_[kHead] = {kNeckForward * s[kSacroiliacToSkullbase], 0, s[kSacroiliacToSkullbase]};
    for (const bool left : {true, false}) {
        const int leg = left ? kThighL : kThighR, arm = left ? kUpperArmL : kUpperArmR;
        offsets_[leg] = mirrored({hips_x, s[kHipHalfWidth], hips_z}, left);
        offsets_[leg + 1] = {0, 0, -s[kThigh]};
        offsets_[leg + 2] = {0, 0, -s[kShank]};
        offsets_[arm] = mirrored(
            {-0.005 * s[kSacroiliacToShoulders], s[kShoulderHalfWidth], s[kSacroiliacToShoulders]}, left);
        offsets_[arm + 1] = {0, 0, -s[kUpperArm]};
        offsets_[arm + 2] = {0, 0, -s[kForearm]};
    }
    joint_offsets_.fill({0, 0, 0});
    joint_offsets_[kHeadTop] = {kNeckForward * 4 * s[kSkullbaseToHeadTop], 0,
                                s[kSkullbaseToHeadTop]};  // in front of the neck
    for (const int hand : {kHandTipL, kHandTipR})
        joint_offsets_[hand] = {-kHandBack * s[kHand], 0, -s[kHand]};
    for (const bool left : {true, false})
        joint_offsets_[left ? kToeL : kToeR] = mirrored(
            {s[kAnkleToToe], kToeOut * s[kAnkleToToe], 0.8 * s[kFootRadius] - s[kAnkleHeight]}, left);
}

Vec3 BodyModel::shoulder_shift(bool left, Vec3 arm_direction) const {
    const Vec3 from_hanging = mirrored(arm_direction - kDown, left);
    return (shape_.stature_m / kRhythmStature) * mirrored(kRhythm * from_hanging, left) +
           shape_[kShoulderRise] * risen(arm_direction);
}

Vec3 BodyModel::risen(Vec3 arm_direction) {
    return {0, 0, (arm_direction.z - kDown.z) / 2};
}

PosedBody BodyModel::forward(const BodyPosture& posture) const {
    PosedBody posed;
    posed.world_from_segment[kPelvis] = {posture.parent_from_segment[kPelvis], posture.root_in_world};
    for (int s = 1; s < kBodySegmentCount; ++s) {
        const Mat3& rotation = posture.parent_from_segment[s];
        Vec3 offset = offsets_[s];
        if (s == kUpperArmL || s == kUpperArmR) offset += shoulder_shift(s == kUpperArmL, rotation * kDown);
        posed.world_from_segment[s] = posed.world_from_segment[kBodyParent[s]] * Rigid3{rotation, offset};
    }
    for (std::size_t j = 0; j < kJointNames.size(); ++j)
        posed.joints_in_world[j] = posed.world_from_segment[kJointSegment[j]] * joint_offsets_[j];
    return posed;
}

void BodyModel::capsules(const PosedBody& posed, std::vector<BodyCapsule>& out) const {
    out.resize(capsules_.size());
    for (std::size_t k = 0; k < capsules_.size(); ++k)
        out[k] = capsule_in_world(posed.world_from_segment[capsules_[k].segment], capsules_[k]);
}

std::array<DofFrame, kBodyDofCount> BodyModel::dof_frames(const PosedBody& posed) const {
    constexpr Vec3 kAxes[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    std::array<DofFrame, kBodyDofCount> frames;
    for (int k = 0; k < 3; ++k) frames[kDofRootPosition + k].shift = kAxes[k];
    for (int s = 0; s < kBodySegmentCount; ++s) {
        const Vec3 origin = posed.world_from_segment[s].translation;
        const Mat3 world_from_parent =
            s == kPelvis ? Mat3{} : posed.world_from_segment[kBodyParent[s]].rotation;
        DofFrame* own = frames.data() + kSegmentDof[s];
        if (kSegmentDofCount[s] == 1) {
            own[0] = {world_from_parent * hinge_axis(s), origin, {}};
            continue;
        }
        const bool shoulder = s == kUpperArmL || s == kUpperArmR;
        const Vec3 arm = world_from_parent.transposed() * (posed.world_from_segment[s].rotation * kDown);
        for (int k = 0; k < 3; ++k) {
            own[k] = {world_from_parent * kAxes[k], origin, {}};
            // The shift of the girdle is linear in the arm's direction, so its derivative is the shift of the
            // direction's derivative.
            if (shoulder)
                own[k].shift =
                    world_from_parent * shoulder_shift(s == kUpperArmL, cross(kAxes[k], arm) + kDown);
        }
    }
    return frames;
}

std::array<Vec3, kBodyDofCount> BodyModel::point_jacobian(const std::array<DofFrame, kBodyDofCount>& frames,
                                                          int segment, Vec3 point) {
    std::array<Vec3, kBodyDofCount> columns{};
    for (const int k : dofs_of_segment(segment))
        columns[k] = cross(frames[k].axis, point - frames[k].origin) + frames[k].shift;
    return columns;
}

std::size_t origin_joint(int segment) {
    return static_cast<std::size_t>(std::ranges::find(kJointSegment, segment) - kJointSegment.begin());
}

std::span<const int> dofs_of_segment(int segment) {
    struct Chains {
        std::array<std::array<int, kBodyDofCount>, kBodySegmentCount> dofs{};
        std::array<std::size_t, kBodySegmentCount> count{};
    };
    static const Chains chains = [] {
        Chains made;
        for (int s = 0; s < kBodySegmentCount; ++s) {
            std::array<bool, kBodyDofCount> moves{true, true, true};
            for (int at = s; at >= 0; at = kBodyParent[at])
                for (int k = 0; k < kSegmentDofCount[at]; ++k) moves[kSegmentDof[at] + k] = true;
            for (int k = 0; k < kBodyDofCount; ++k)
                if (moves[k]) made.dofs[s][made.count[s]++] = k;
        }
        return made;
    }();
    return {chains.dofs[segment].data(), chains.count[segment]};
}

double max_joint_distance(const JointPositions& a, const JointPositions& b) {
    double most = 0;
    for (std::size_t j = 0; j < a.size(); ++j) most = std::max(most, norm(a[j] - b[j]));
    return most;
}

}  // namespace kinevox
