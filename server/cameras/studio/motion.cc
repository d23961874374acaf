#include "server/cameras/studio/motion.h"

#include <absl/status/status.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace kinevox::studio {
namespace {

double ease(double s) {
    s = std::clamp(s, 0.0, 1.0);
    return s * s * (3 - 2 * s);
}

// The ankle of a foot whose ball (pitch > 0) or heel (pitch < 0) rests where the flat foot's would.
PlacedFoot pivot(const Measures& m, Vec3 ball, double yaw, double pitch) {
    PlacedFoot foot;
    foot.world_from_foot = rotation_z(yaw) * rotation_y(pitch);
    const Vec3 pivot_in_foot = pitch > 0 ? Vec3{m.foot_ball_x, 0, m.ball_height - m.ankle_height}
                                         : Vec3{m.foot_heel_x, 0, -m.ankle_height};
    const Vec3 ankle_when_flat = ball + rotation_z(yaw) * Vec3{-m.foot_ball_x, 0, m.ankle_height};
    const Vec3 pivot_in_world = ankle_when_flat + rotation_z(yaw) * pivot_in_foot;
    foot.ankle_in_world = pivot_in_world - foot.world_from_foot * pivot_in_foot;
    foot.toe_extension = std::max(pitch, 0.0);
    foot.in_contact = true;
    return foot;
}

double contact_pitch(const Contact& c, double t) {
    const double s = (t - c.on_s) / (c.off_s - c.on_s);
    if (s < c.flat_from) return c.strike_pitch * (1 - ease(s / c.flat_from));
    if (s <= c.flat_until) return 0;
    const double u = (s - c.flat_until) / (1 - c.flat_until);
    return c.off_pitch * std::pow(u, 1.7);
}

PlacedFoot in_contact(const Measures& m, const Contact& c, double t) {
    return pivot(m, c.ball_in_world, c.yaw, contact_pitch(c, t));
}

double hermite(double p0, double v0, double p1, double v1, double s) {
    const double s2 = s * s, s3 = s2 * s;
    return p0 * (2 * s3 - 3 * s2 + 1) + v0 * (s3 - 2 * s2 + s) + p1 * (3 * s2 - 2 * s3) + v1 * (s3 - s2);
}

// Depth of a swinging foot's sole below its ankle.
double sole_below_ankle(const Measures& m, const PlacedFoot& foot) {
    const double ball_x = m.foot_ball_x, toe_x = ball_x + m.toe_length * std::cos(foot.toe_extension);
    const double toe_z = -m.ankle_height + m.toe_length * std::sin(foot.toe_extension);
    double lowest = 0;
    for (const Vec3 p :
         {Vec3{m.foot_heel_x, 0, -m.ankle_height}, Vec3{ball_x, 0, -m.ankle_height}, Vec3{toe_x, 0, toe_z}})
        lowest = std::min(lowest, (foot.world_from_foot * p).z);
    return -lowest;
}

}  // namespace

Stage natural_stage(std::string_view motion) {
    return motion == "run" || motion == "sprint_start" ? Stage::kLane : Stage::kRoom;
}

absl::StatusOr<std::unique_ptr<Motion>> make_motion(std::string_view name, Stage stage, const Rig& rig) {
    if (name == "walk") return make_gait(false, stage, rig);
    if (name == "run") return make_gait(true, stage, rig);
    if (name == "sprint_start") return make_sprint_start(rig);
    if (name == "squat") return make_squat(rig);
    if (name == "jumping_jack") return make_jumping_jack(rig);
    if (name == "arm_raise") return make_arm_raise(rig);
    if (name == "stand") return make_stand(rig);
    if (name == "jump") return make_jump(rig);
    if (name == "punch") return make_punch(rig);
    if (name == "kick") return make_kick(rig);
    if (name == "get_up") return make_get_up(rig);
    return absl::InvalidArgumentError(
        fmt::format("motion '{}' is unknown; there are {}", name, fmt::join(kMotionNames, ", ")));
}

PlacedFoot place_foot(const Measures& m, const Contact& current, const Contact& next, double t) {
    if (t < current.off_s) return in_contact(m, current, t);
    const double swing = next.on_s - current.off_s, s = std::clamp((t - current.off_s) / swing, 0.0, 1.0);
    const PlacedFoot from = in_contact(m, current, current.off_s), to = in_contact(m, next, next.on_s);
    constexpr double kStep = 1e-3;
    const PlacedFoot before = in_contact(m, current, current.off_s - kStep),
                     after = in_contact(m, next, next.on_s + kStep);
    const Vec3 leave = (swing / kStep) * (from.ankle_in_world - before.ankle_in_world);
    const Vec3 arrive = (swing / kStep) * (after.ankle_in_world - to.ankle_in_world);
    const Vec3 a = from.ankle_in_world, b = to.ankle_in_world;

    PlacedFoot foot;
    const double bump = 16 * s * s * (1 - s) * (1 - s);
    foot.ankle_in_world = {hermite(a.x, leave.x, b.x, arrive.x, s), hermite(a.y, leave.y, b.y, arrive.y, s),
                           hermite(a.z, leave.z, b.z, arrive.z, s) + current.swing_lift_m * bump};
    const double turn = std::remainder(next.yaw - current.yaw, 2 * 3.14159265358979323846);
    // The foot continues to pitch shortly after toe-off, then levels early.
    const double pitch =
        hermite(current.off_pitch, 0.6 * current.off_pitch, next.strike_pitch, 0, ease(1.15 * s));
    foot.world_from_foot = rotation_z(current.yaw + turn * ease(s)) * rotation_y(pitch);
    foot.toe_extension = std::max(current.off_pitch, 0.0) * (1 - ease(2.5 * s)) +
                         std::max(next.strike_pitch, 0.0) * ease(4 * s - 3);
    const double needed = sole_below_ankle(m, foot) + 0.012 * std::min(1.0, 8 * bump);
    foot.ankle_in_world.z = std::max(foot.ankle_in_world.z, needed);
    return foot;
}

PlacedFoot flat_foot(const Measures& m, Vec3 ankle_on_floor, double yaw) {
    PlacedFoot foot;
    foot.ankle_in_world = {ankle_on_floor.x, ankle_on_floor.y, ankle_on_floor.z + m.ankle_height};
    foot.world_from_foot = rotation_z(yaw);
    foot.in_contact = ankle_on_floor.z < 1e-6;
    return foot;
}

void put_on_feet(const Rig& rig, Pose& pose, const std::array<PlacedFoot, 2>& feet, double yaw) {
    const Measures& m = rig.measures();
    const double longest = 0.992 * m.leg();
    for (Side side : kSides) {  // lower the pelvis until both standing legs are long enough
        const PlacedFoot& foot = feet[side == Side::kRight];
        if (!foot.in_contact) continue;
        const Vec3 hip = pose.root_in_world + pose[kPelvis] * rig.offset_in_parent(on_side(kThighL, side));
        const Vec3 offset = foot.ankle_in_world - hip;
        const double flat = std::min(std::hypot(offset.x, offset.y), longest);
        const double highest = std::sqrt(longest * longest - flat * flat);
        if (-offset.z > highest) pose.root_in_world.z -= -offset.z - highest;
    }
    for (Side side : kSides) {
        const PlacedFoot& foot = feet[side == Side::kRight];
        const double foot_yaw = std::atan2(foot.world_from_foot(1, 0), foot.world_from_foot(0, 0));
        const bool upside = foot.world_from_foot(2, 2) < 0;  // a heel kicked up past the vertical
        const double knee_yaw =
            upside ? yaw : yaw + 0.7 * std::remainder(foot_yaw - yaw, 2 * 3.14159265358979323846);
        rig.place_leg(pose, side, foot.ankle_in_world, foot.world_from_foot,
                      rotation_z(knee_yaw) * Vec3{1, 0, 0.35});
        pose[on_side(kToesL, side)] = rotation_y(-foot.toe_extension);
    }
}

void pose_arm(Pose& pose, Side side, double flexion, double abduction, double external_rotation,
              double elbow) {
    const double s = sign_of(side);
    const double raised = std::max({flexion, abduction, 0.0});
    const double girdle = 0.22 * std::max(0.0, raised - radians(40));
    pose[on_side(kClavicleL, side)] = rotation_x(s * girdle);
    const Mat3 upper = limb_rotation(side, flexion, abduction, external_rotation);
    pose[on_side(kUpperArmL, side)] = rotation_x(-s * girdle) * upper;
    pose[on_side(kForearmL, side)] = rotation_y(-elbow);
    pose[on_side(kHandL, side)] = rotation_y(-radians(6));
}

}  // namespace kinevox::studio
