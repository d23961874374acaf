#include "server/pose/database/bvh_import.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/pose/database/bvh_names.h"

namespace kinevox {
namespace {

Vec3 without(Vec3 v, Vec3 direction) {
    return v - dot(v, direction) * direction;
}

// Columns: a frame's axes in the world; z is kept, x is as close to `x` as possible.
Mat3 axes_from(Vec3 z, Vec3 x) {
    z = normalized(z);
    x = without(x, z);
    if (!(norm(x) > 1e-9)) x = without(std::fabs(z.x) < 0.9 ? Vec3{1, 0, 0} : Vec3{0, 1, 0}, z);
    x = normalized(x);
    const Vec3 y = cross(z, x);
    return {{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}};
}
Vec3 column(const Mat3& m, int n) {
    return {m(0, n), m(1, n), m(2, n)};
}

double angle_between(Vec3 a, Vec3 b) {
    return std::atan2(norm(cross(a, b)), dot(a, b));
}

class Retargeting {
  public:
    Retargeting(const BvhMotion& motion, const std::array<int, kBvhRoleCount>& roles)
        : motion_(motion), roles_(roles) {
        // Our z is the file's up: the axis along which its zero pose is longest from the hips to the neck.
        const std::vector<Rigid3> rest = motion.rest();
        const Vec3 spine = rest[roles[kBvhNeck]].translation - rest[roles[kBvhRoot]].translation;
        y_up_ = std::fabs(spine.y) >= std::fabs(spine.z);
        for (const int side : {0, 1}) {
            const Vec3 foot = foot_direction(rest, side);
            toe_slope_[side] = std::atan2(foot.z, std::hypot(foot.x, foot.y));
        }
    }

    BodyCoordinates pose(int frame) {
        joints_ = motion_.pose(frame);
        const Vec3 hips = 0.5 * (at(kBvhHipL) + at(kBvhHipR)),
                   shoulders = 0.5 * (at(kBvhShoulderL) + at(kBvhShoulderR));
        const Vec3 neck = at(kBvhNeck), waist = roles_[kBvhSpine] >= 0 ? at(kBvhSpine) : hips;
        const Vec3 hip_line = at(kBvhHipL) - at(kBvhHipR),
                   shoulder_line = at(kBvhShoulderL) - at(kBvhShoulderR);
        std::array<Mat3, kBodySegmentCount> world;
        // From the waist if it is far enough above the hips to define a direction, else from the trunk's
        // centre.
        const double trunk = norm(shoulders - hips);
        const Vec3 pelvis_up = norm(waist - hips) > 0.12 * trunk ? waist - hips : shoulders - hips;
        world[kPelvis] = axes_from(without(pelvis_up, normalized(hip_line)), cross(hip_line, pelvis_up));
        const Vec3 chest_up = norm(neck - waist) > 0.3 * trunk ? neck - waist : neck - hips;
        world[kThorax] = axes_from(chest_up, cross(shoulder_line, chest_up));
        world[kHead] = world[kThorax];
        if (const int head = roles_[kBvhHead];
            head >= 0 && motion_.joints[head].has_end && norm(motion_.joints[head].end) > 1e-9)
            world[kHead] = axes_from(turned(joints_[head].rotation * motion_.joints[head].end),
                                     column(world[kThorax], 0));
        for (const int side : {0, 1}) {
            leg(side, world);
            arm(side, world);
        }
        BodyPosture posture;
        posture.parent_from_segment[kPelvis] = world[kPelvis];
        for (int s = 1; s < kBodySegmentCount; ++s)
            posture.parent_from_segment[s] = world[kBodyParent[s]].transposed() * world[s];
        BodyCoordinates q = coordinates_from_posture(posture);
        for (const int side : {0, 1}) {  // hinges that positions determine exactly
            q[kDofKneeL + side * kDofRight] = knee_[side];
            q[kDofAnkleL + side * kDofRight] = ankle_[side];
            q[kDofElbowL + side * kDofRight] = elbow_[side];
            q[kDofWristL + side * kDofRight] = 0;
        }
        q[0] = q[1] = q[2] = q[kDofRootRotation + 2] = 0;
        for (int dof = kDofSacroiliac; dof < kBodyDofCount; ++dof)
            q[dof] = std::clamp(q[dof], kBodyDofs[dof].lower, kBodyDofs[dof].upper);
        return q;
    }

  private:
    static constexpr int kRight = kBvhHipR - kBvhHipL, kDofRight = kDofHipR - kDofHipL;

    Vec3 turned(Vec3 v) const { return y_up_ ? Vec3{v.z, v.x, v.y} : v; }
    // From the ankle to the toes or, without a toe joint, to the foot's end site; 0 without either.
    Vec3 foot_direction(const std::vector<Rigid3>& joints, int side) const {
        const int ankle = roles_[kBvhAnkleL + side * kRight], toe = roles_[kBvhToeL + side * kRight];
        if (toe >= 0) return turned(joints[toe].translation - joints[ankle].translation);
        const BvhJoint& foot = motion_.joints[ankle];
        return foot.has_end ? turned(joints[ankle].rotation * foot.end) : Vec3{};
    }
    Vec3 at(int role) const { return turned(joints_[roles_[role]].translation); }

    void leg(int side, std::array<Mat3, kBodySegmentCount>& world) {
        const int role = side * kRight, segment = side == 0 ? kThighL : kThighR;
        const Vec3 thigh = at(kBvhKneeL + role) - at(kBvhHipL + role),
                   shank = at(kBvhAnkleL + role) - at(kBvhKneeL + role);
        // The knee's axis: across the plane in which it bends; a straight leg has none, then the pelvis'
        // decides.
        const Vec3 bend = cross(normalized(thigh), normalized(shank));
        const Vec3 axis = bend + 0.12 * column(world[kPelvis], 1);
        world[segment] = axes_from(-thigh, cross(axis, -thigh));
        knee_[side] = angle_between(thigh, shank) * (dot(bend, column(world[segment], 1)) < 0 ? -1 : 1);
        world[segment + 1] = axes_from(-shank, cross(column(world[segment], 1), -shank));
        ankle_[side] = 0;
        const Vec3 foot = foot_direction(joints_, side);
        if (norm(foot) > 0) {
            const double forward = dot(foot, column(world[segment + 1], 0)),
                         up = dot(foot, column(world[segment + 1], 2));
            ankle_[side] = std::remainder(std::atan2(up, forward) - toe_slope_[side], 2 * std::numbers::pi);
        }
        world[segment + 2] = world[segment + 1];
    }

    void arm(int side, std::array<Mat3, kBodySegmentCount>& world) {
        const int role = side * kRight, segment = side == 0 ? kUpperArmL : kUpperArmR;
        const Vec3 upper = at(kBvhElbowL + role) - at(kBvhShoulderL + role),
                   fore = at(kBvhWristL + role) - at(kBvhElbowL + role);
        const Vec3 u = normalized(upper), forward = column(world[kThorax], 0), up = column(world[kThorax], 2);
        // The bending direction of the forearm; for a straight arm, the thorax' forward axis rotated with the
        // arm.
        const double raised = dot(u, forward);
        const Vec3 front = (1 - std::fabs(raised)) * forward + raised * up;
        world[segment] = axes_from(-upper, without(normalized(fore), u) + 0.1 * without(front, u));
        elbow_[side] = angle_between(upper, fore);
        world[segment + 1] = axes_from(-fore, cross(column(world[segment], 1), -fore));
        world[segment + 2] = world[segment + 1];
    }

    const BvhMotion& motion_;
    const std::array<int, kBvhRoleCount>& roles_;
    bool y_up_ = true;
    double toe_slope_[2] = {0, 0};
    std::vector<Rigid3> joints_;
    double knee_[2] = {}, ankle_[2] = {}, elbow_[2] = {};
};

}  // namespace

absl::StatusOr<std::vector<LibraryPose>> poses_from_bvh(const BvhMotion& motion, const std::string& label,
                                                        const BvhImportOptions& options) {
    if (!(options.interval_s >= 0) || options.max_poses < 1)
        return absl::InvalidArgumentError("bvh: interval_s must not be negative and max_poses at least 1");
    if (label.empty() || label.size() > 180 || label.find('\n') != std::string::npos)
        return absl::InvalidArgumentError("bvh: the label must be one line of 1 to 180 characters");
    const auto roles = bvh_roles(motion.joints);
    if (!roles.ok()) return absl::InvalidArgumentError(label + ": " + std::string(roles.status().message()));
    Retargeting retargeting(motion, *roles);
    const double by_time = options.interval_s / motion.frame_time_s,
                 by_count = static_cast<double>(motion.frames) / options.max_poses;
    const double step = std::max({1.0, std::min(by_time, 1e9), by_count});
    std::vector<LibraryPose> poses;
    for (double place = 0; place < motion.frames; place += step) {
        const int frame = static_cast<int>(place);
        LibraryPose pose{fmt::format("{}, {:.2f} s", label, frame * motion.frame_time_s),
                         retargeting.pose(frame), true};
        for (const double value : pose.coordinates)
            if (!std::isfinite(value))
                return absl::InvalidArgumentError(
                    fmt::format("{}: frame {}: joints coincide; check the offsets", label, frame));
        poses.push_back(std::move(pose));
    }
    return poses;
}

}  // namespace kinevox
