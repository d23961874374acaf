// Walking and running at a steady pace. Times, step lengths and amplitudes follow the descriptions of normal
// gait in Perry, Gait Analysis (1992), and Novacheck, The biomechanics of running, Gait & Posture 7 (1998).
#include <cmath>
#include <numbers>

#include "server/cameras/studio/motion.h"

namespace kinevox::studio {
namespace {

using std::numbers::pi;

struct GaitStyle {
    double speed_per_stature;  // 1/s; times stature: m/s
    double stride_s;           // two steps
    double duty;               // stance fraction of the stride
    double step_width_m, foot_out;
    double strike_pitch, off_pitch, flat_from, flat_until, swing_lift_per_stature;
    double ball_ahead_per_stature;  // ball of the foot before the pelvis at mid stance
    double root_below_standing;     // m, mean
    double bob_m, bob_at;           // highest at this fraction of the stride and half a stride later
    double sway_m, pelvis_turn, pelvis_list, pelvis_tilt, trunk_lean;
    double arm_mean, arm_swing, arm_abduction, arm_rotation, elbow_mean, elbow_swing;
};

GaitStyle walk_style() {
    return {.speed_per_stature = 0.74,
            .stride_s = 1.08,
            .duty = 0.62,
            .step_width_m = 0.11,
            .foot_out = radians(7),
            .strike_pitch = radians(-20),
            .off_pitch = radians(58),
            .flat_from = 0.14,
            .flat_until = 0.50,
            .swing_lift_per_stature = 0.012,
            .ball_ahead_per_stature = 0.035,
            .root_below_standing = 0.030,
            .bob_m = 0.018,
            .bob_at = 0.31,
            .sway_m = 0.020,
            .pelvis_turn = radians(6),
            .pelvis_list = radians(4),
            .pelvis_tilt = radians(4),
            .trunk_lean = radians(3),
            .arm_mean = radians(2),
            .arm_swing = radians(23),
            .arm_abduction = radians(7),
            .arm_rotation = radians(-12),
            .elbow_mean = radians(20),
            .elbow_swing = radians(11)};
}

GaitStyle run_style() {
    return {.speed_per_stature = 1.85,
            .stride_s = 0.72,
            .duty = 0.33,
            .step_width_m = 0.06,
            .foot_out = radians(5),
            .strike_pitch = radians(-7),
            .off_pitch = radians(68),
            .flat_from = 0.20,
            .flat_until = 0.48,
            .swing_lift_per_stature = 0.17,
            .ball_ahead_per_stature = 0.03,
            .root_below_standing = 0.055,
            .bob_m = 0.038,
            .bob_at = 0.42,
            .sway_m = 0.008,
            .pelvis_turn = radians(9),
            .pelvis_list = radians(5),
            .pelvis_tilt = radians(11),
            .trunk_lean = radians(7),
            .arm_mean = radians(-4),
            .arm_swing = radians(36),
            .arm_abduction = radians(11),
            .arm_rotation = radians(-28),
            .elbow_mean = radians(92),
            .elbow_swing = radians(16)};
}

class Gait final : public Motion {
  public:
    Gait(bool run, Stage stage, const Rig& rig)
        : style_(run ? run_style() : walk_style()), rig_(rig), stage_(stage) {
        speed_ = style_.speed_per_stature * rig.measures().stature;
        const double stride = speed_ * style_.stride_s;
        if (stage == Stage::kLane) strides_in_lane_ = std::floor((kLaneEnd - kLaneStart) / stride);
        radius_ = run ? 2.0 : 1.35;
    }
    double period_s() const override { return strides_in_lane_ * style_.stride_s; }
    Pose pose(double time_s) const override;

  private:
    static constexpr double kLaneStart = 0.5, kLaneEnd = 11.5;
    struct Place {
        Vec3 point;
        double yaw;
    };
    // Where the path is after `distance` metres, `left` metres to its left: a circle in the room, the lane's
    // centre line.
    Place path(double distance, double left) const {
        if (stage_ == Stage::kLane) return {{kLaneStart + distance, left, 0}, 0};
        const double angle = distance / radius_;
        return {{(radius_ - left) * std::cos(angle), (radius_ - left) * std::sin(angle), 0}, angle + pi / 2};
    }
    // The `index`th stance; the right foot is half a stride later.
    Contact contact(Side side, double index) const {
        const double start = (index + (side == Side::kRight ? 0.5 : 0.0)) * style_.stride_s;
        const double middle = start + 0.5 * style_.duty * style_.stride_s, s = sign_of(side);
        const double height = rig_.measures().stature;
        const Place place =
            path(speed_ * middle + style_.ball_ahead_per_stature * height, s * 0.5 * style_.step_width_m);
        return {.on_s = start,
                .off_s = start + style_.duty * style_.stride_s,
                .ball_in_world = place.point,
                .yaw = place.yaw + s * style_.foot_out,
                .strike_pitch = style_.strike_pitch,
                .off_pitch = style_.off_pitch,
                .flat_from = style_.flat_from,
                .flat_until = style_.flat_until,
                .swing_lift_m = style_.swing_lift_per_stature * height};
    }

    GaitStyle style_;
    const Rig& rig_;
    Stage stage_;
    double speed_ = 0, radius_ = 0, strides_in_lane_ = 0;
};

Pose Gait::pose(double time_s) const {
    const double t = period_s() > 0 ? std::fmod(time_s, period_s()) : time_s;
    const double phase = 2 * pi * t / style_.stride_s;                        // 0: the left foot comes down
    const double stance_side = std::cos(phase - 2 * pi * 0.5 * style_.duty);  // +1: mid left stance
    const Place place = path(speed_ * t, style_.sway_m * stance_side);
    // Leans into the bend according to speed and gravity.
    const double bank = stage_ == Stage::kLane ? 0.0 : 0.8 * std::atan(speed_ * speed_ / (9.81 * radius_));

    Pose pose;
    pose.root_in_world = place.point;
    pose.root_in_world.z = rig_.measures().standing_root_z() - style_.root_below_standing +
                           style_.bob_m * std::cos(2 * phase - 4 * pi * style_.bob_at);
    const double turn = -style_.pelvis_turn * std::cos(phase),
                 list = style_.pelvis_list * std::cos(phase - 0.4 * pi);
    pose[kPelvis] = rotation_z(place.yaw) * rotation_x(-bank) * rotation_z(turn) *
                    rotation_y(style_.pelvis_tilt) * rotation_x(list);
    pose[kLumbar] = rotation_x(-0.6 * list) * rotation_y(style_.trunk_lean - style_.pelvis_tilt) *
                    rotation_z(-0.9 * turn);
    pose[kThorax] = rotation_x(-0.4 * list) * rotation_z(-0.9 * turn);
    pose[kNeck] = rotation_z(0.5 * turn) * rotation_y(radians(6));
    pose[kHead] =
        rotation_z(0.3 * turn) * rotation_x(0.6 * bank) * rotation_y(-style_.trunk_lean - radians(4));

    std::array<PlacedFoot, 2> feet;
    for (Side side : kSides) {
        const double own = t / style_.stride_s - (side == Side::kRight ? 0.5 : 0.0);
        const double index = std::floor(own);
        feet[side == Side::kRight] =
            place_foot(rig_.measures(), contact(side, index), contact(side, index + 1), t);
        const double swing = -sign_of(side) * std::cos(phase + 0.15);
        pose_arm(pose, side, style_.arm_mean + style_.arm_swing * swing, style_.arm_abduction,
                 style_.arm_rotation, style_.elbow_mean + style_.elbow_swing * swing);
    }
    put_on_feet(rig_, pose, feet, place.yaw);
    return pose;
}

}  // namespace

std::unique_ptr<Motion> make_gait(bool run, Stage stage, const Rig& rig) {
    return std::make_unique<Gait>(run, stage, rig);
}

}  // namespace kinevox::studio
