// The articulated body: 15 segments, 32 degrees of freedom, a surface of tapered capsules.
//
// Frames. At the zero pose the subject stands upright with hanging arms, palms towards the thighs, and every
// segment's axes are parallel to the world's: x forward, y to the subject's left, z up. A segment's origin is
// its joint with its parent (the pelvis': the root). Rotations are `parent_from_segment`.
//
// Coordinates. BodyCoordinates are named anatomical angles (names and signs as in OpenSim's full-body models,
// Hamner et al. 2010 and Rajagopal et al. 2016). Ball joints: flexion about the parent's axis, then adduction
// or bending, then rotation about the segment's own long axis (Grood & Suntay 1983; Wu et al. 2002). The
// pelvis uses the other order, rotation about the vertical, then obliquity, then tilt (Baker 2001), so that
// its singular pose is lying on the side and not a deep forward lean.
//
// Steps. Euler angles are singular within a shoulder's range of motion, so a BodyPosture keeps rotation
// matrices, and steps and Jacobians are taken in its tangent space: BodyStep has the order of
// BodyCoordinates, but the three entries of a ball joint are the rotation vector's x, y, z in the parent's
// axes: posture.R = exp(step)
// * posture.R.
#pragma once

#include <array>
#include <span>
#include <string_view>
#include <vector>

#include "common/body_table.h"
#include "common/geometry.h"
#include "server/pose/body_shape.h"

namespace kinevox {

// m for the root's position, rad for all others; the order of kBodyDofs.
using BodyCoordinates = std::array<double, kBodyDofCount>;
// As above, in the tangent space (see the top of this file).
using BodyStep = std::array<double, kBodyDofCount>;

struct BodyPosture {
    Vec3 root_in_world;
    std::array<Mat3, kBodySegmentCount> parent_from_segment;  // the pelvis' parent is the world
    bool operator==(const BodyPosture&) const = default;
};
BodyPosture posture_from_coordinates(const BodyCoordinates& coordinates);
// Angles of a ball joint at its singular pose (adduction or obliquity of 90 deg): the rotation about the long
// axis is 0.
BodyCoordinates coordinates_from_posture(const BodyPosture& posture);
// Writes the coordinates of one segment's joint.
void read_coordinates(const BodyPosture& posture, int segment, BodyCoordinates& coordinates);
// The posture after a step in the tangent space.
BodyPosture stepped(const BodyPosture& posture, std::span<const double, kBodyDofCount> step);
// The step from `a` to `b`: stepped(a, step_between(a, b)) is b up to rounding (hinges: their angles'
// difference).
BodyStep step_between(const BodyPosture& a, const BodyPosture& b);
// The posture after a fraction of that step: 0 is `a`, 1 is `b`, above 1 beyond it.
BodyPosture between(const BodyPosture& a, const BodyPosture& b, double fraction);

// A capsule of the surface: all points nearer to the segment a-b than a radius that goes linearly from
// radius_a at a to radius_b at b. Plain floats, so that renderers need nothing else.
struct BodyCapsule {
    int segment = 0;  // BodySegment
    float a[3] = {}, b[3] = {};
    float radius_a = 0, radius_b = 0;  // m
};

BodyCapsule capsule_in_world(const Rigid3& world_from_segment, BodyCapsule in_segment);

using JointPositions = std::array<Vec3, kJointNames.size()>;  // in the order of kJointNames
double max_joint_distance(const JointPositions& a, const JointPositions& b);

struct PosedBody {
    std::array<Rigid3, kBodySegmentCount> world_from_segment;
    JointPositions joints_in_world;
};

// Velocity of points per degree of freedom: d point / d step = axis x (point - origin) + shift, world
// frame.
struct DofFrame {
    Vec3 axis, origin, shift;
};

// The joint at a segment's origin, as index of kJointNames.
std::size_t origin_joint(int segment);

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
    // A joint of kJointNames in the frame of its segment, kJointSegment.
    Vec3 joint_in_segment(int joint) const { return joint_offsets_[joint]; }

    // In the parent's frame, at hanging arms (see shoulder_shift).
    Vec3 offset_in_parent(int segment) const { return offsets_[segment]; }

    // The shoulder girdle has no degree of freedom of its own: raising the arm raises the shoulder's centre,
    // stretching it forward moves it forward (scapulohumeral rhythm). Shift in the thorax' frame, m, for the
    // direction of the upper arm in the thorax' frame; linear in it.
    Vec3 shoulder_shift(bool left, Vec3 arm_direction) const;
    // Its derivative by kShoulderRise.
    static Vec3 risen(Vec3 arm_direction);

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
