// The articulated body: 15 segments, 32 degrees of freedom, a surface of tapered capsules.
//
// Frames. At the zero pose the subject stands upright with hanging arms, palms towards the thighs, and every
// segment's axes are parallel to the world's: x forward, y to the subject's left, z up. A segment's origin is
// its joint with its parent (the pelvis': the root). Rotations are `parent_from_segment`.
//
// Coordinates. BodyCoordinates are named anatomical angles (names and signs as in OpenSim's full-body models,
// Hamner et al. 2010 and Rajagopal et al. 2016). Ball joints: flexion about the parent's axis, then adduction
// or bending, then rotation about the segment's own long axis (Grood & Suntay 1983; Wu et al. 2002). The
// pelvis turns in the other order, rotation about the world's vertical, then list, then tilt (Baker 2001), so
// that its singular pose is lying on one's side and not a deep forward lean.
//
// Steps. Euler angles are singular somewhere a shoulder can go, so a BodyPosture keeps rotation matrices, and
// steps and Jacobians are taken in its tangent space: BodyStep has the order of BodyCoordinates, but the
// three entries of a ball joint are the rotation vector's x, y, z in the parent's axes: posture.R = exp(step)
// * posture.R.
#pragma once

#include <array>
#include <span>
#include <string_view>
#include <vector>

#include "common/geometry.h"
#include "common/skeleton.h"
#include "server/pose/body_shape.h"

namespace kinevox {

inline constexpr int kBodyDofCount = 32;

// Where each joint's degrees of freedom begin.
enum BodyDof : int {
    kDofRootPosition = 0,
    kDofRootRotation = 3,
    kDofSacroiliac = 6,
    kDofSkullbase = 9,
    kDofHipL = 12,
    kDofKneeL = 15,
    kDofAnkleL = 16,
    kDofShoulderL = 17,
    kDofElbowL = 20,
    kDofWristL = 21,
    kDofHipR = 22,
    kDofKneeR = 25,
    kDofAnkleR = 26,
    kDofShoulderR = 27,
    kDofElbowR = 30,
    kDofWristR = 31,
};
constexpr bool is_position(int dof) {
    return dof < kDofRootRotation;
}  // m; all others are angles, rad

struct BodyDofInfo {
    std::string_view name;
    double lower, upper;  // limits of movement, rad; infinite for the root
};
// Limits: active ranges of motion of healthy adults with about 10 deg beyond the mean: hip, knee, ankle Roaas
// & Andersson (1982); shoulder, elbow, wrist Boone & Azen (1979); trunk and neck White & Panjabi (1990), the
// trunk's being the sum over the thoracic and lumbar spine, since one joint stands for it.
extern const std::array<BodyDofInfo, kBodyDofCount> kBodyDofs;

// m for the root's position, rad for all others; the order of kBodyDofs.
using BodyCoordinates = std::array<double, kBodyDofCount>;
// As above, in the tangent space (see the top of this file).
using BodyStep = std::array<double, kBodyDofCount>;

enum BodySegment : int {
    kPelvis,
    kThorax,
    kHead,
    kThighL,
    kShankL,
    kFootL,
    kUpperArmL,
    kForearmL,
    kHandL,
    kThighR,
    kShankR,
    kFootR,
    kUpperArmR,
    kForearmR,
    kHandR,
    kBodySegmentCount
};
inline constexpr std::array<std::string_view, kBodySegmentCount> kBodySegmentNames{
    "pelvis", "thorax",  "head",    "thigh_l", "shank_l",     "foot_l",    "upper_arm_l", "forearm_l",
    "hand_l", "thigh_r", "shank_r", "foot_r",  "upper_arm_r", "forearm_r", "hand_r"};
inline constexpr std::array<int, kBodySegmentCount> kBodyParent{
    -1,        kPelvis, kThorax, kPelvis, kThighL, kShankL,    kThorax,  kUpperArmL,
    kForearmL, kPelvis, kThighR, kShankR, kThorax, kUpperArmR, kForearmR};
// First degree of freedom of a segment's joint (the pelvis': of its rotation), and how many there are: 3
// or 1.
inline constexpr std::array<int, kBodySegmentCount> kSegmentDof{
    kDofRootRotation, kDofSacroiliac, kDofSkullbase, kDofHipL,   kDofKneeL,
    kDofAnkleL,       kDofShoulderL,  kDofElbowL,    kDofWristL, kDofHipR,
    kDofKneeR,        kDofAnkleR,     kDofShoulderR, kDofElbowR, kDofWristR};
inline constexpr std::array<int, kBodySegmentCount> kSegmentDofCount{3, 3, 3, 3, 1, 1, 3, 1,
                                                                     1, 3, 1, 1, 3, 1, 1};

struct BodyPosture {
    Vec3 root_in_world;
    std::array<Mat3, kBodySegmentCount> parent_from_segment;  // the pelvis' parent is the world
    bool operator==(const BodyPosture&) const = default;
};
BodyPosture posture_from_coordinates(const BodyCoordinates& coordinates);
// Angles of a ball joint at its singular pose (adduction or list of 90 deg): the rotation about the long axis
// is 0.
BodyCoordinates coordinates_from_posture(const BodyPosture& posture);
// The posture after a step in the tangent space.
BodyPosture stepped(const BodyPosture& posture, std::span<const double, kBodyDofCount> step);
// The step from `a` to `b`: stepped(a, step_between(a, b)) is b up to rounding (hinges: their angles'
// difference).
BodyStep step_between(const BodyPosture& a, const BodyPosture& b);

// A capsule of the surface: all points nearer to the segment a-b than a radius that goes linearly from
// radius_a at a to radius_b at b. Plain floats, so that renderers need nothing else.
struct BodyCapsule {
    int segment = 0;  // BodySegment
    float a[3] = {}, b[3] = {};
    float radius_a = 0, radius_b = 0;  // m
};

struct PosedBody {
    std::array<Rigid3, kBodySegmentCount> world_from_segment;
    std::array<Vec3, kJointNames.size()> joints_in_world;  // in the order of kJointNames
};

// How points move with one degree of freedom: d point / d step = axis x (point - origin) + shift, world
// frame.
struct DofFrame {
    Vec3 axis, origin, shift;
};

// The degrees of freedom that move a segment, ascending.
std::span<const int> dofs_of_segment(int segment);

// Not changed after construction; may be used by several threads.
class BodyModel {
  public:
    explicit BodyModel(const BodyShape& shape);
    const BodyShape& shape() const { return shape_; }

    PosedBody forward(const BodyPosture& posture) const;
    PosedBody forward(const BodyCoordinates& coordinates) const {
        return forward(posture_from_coordinates(coordinates));
    }

    // The surface, in the segments' own frames (always the same number and order) and in the world.
    std::span<const BodyCapsule> capsules_in_segments() const { return capsules_; }
    void capsules(const PosedBody& posed, std::vector<BodyCapsule>& out) const;

    // For all points of segments that dofs_of_segment() says a degree of freedom moves; exact.
    std::array<DofFrame, kBodyDofCount> dof_frames(const PosedBody& posed) const;
    // d point / d step of a point fixed to a segment, from these.
    static std::array<Vec3, kBodyDofCount> point_jacobian(const std::array<DofFrame, kBodyDofCount>& frames,
                                                          int segment, Vec3 point_in_world);
    // The segment that carries a joint of kJointNames, and the joint in that segment's frame. Where a joint
    // lies between two segments it is the farther one's origin.
    static int joint_segment(int joint);
    Vec3 joint_in_segment(int joint) const { return joint_offsets_[joint]; }

    // In the parent's frame, at hanging arms (see shoulder_shift).
    Vec3 offset_in_parent(int segment) const { return offsets_[segment]; }

    // The shoulder girdle has no degree of freedom of its own: raising the arm raises the shoulder's centre,
    // reaching forward brings it forward (scapulohumeral rhythm). Shift in the thorax' frame, m, for the
    // direction of the upper arm in the thorax' frame; linear in it.
    Vec3 shoulder_shift(bool left, Vec3 arm_direction) const;

  private:
    BodyShape shape_;
    std::array<Vec3, kBodySegmentCount> offsets_;
    std::array<Vec3, kJointNames.size()> joint_offsets_;
    std::vector<BodyCapsule> capsules_;
};

// Of a hinge: the axis in the parent's frame about which its coordinate is positive.
Vec3 hinge_axis(int segment);

// d coordinates / d step: a 3 x 3 block for each ball joint (row: angle, column: rotation vector), 1 for a
// hinge. Near a singular pose the block is damped rather than infinite.
Mat3 euler_rates(int segment, const Mat3& parent_from_segment);

}  // namespace kinevox
