// Jumps, punches and kicks on the spot. Endless and periodic.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/cameras/studio/motion.h"

namespace kinevox::studio {
namespace {

using std::numbers::pi;

const Vec3 kForward{0.9396926207859084, 0.34202014332566873, 0};  // of the subject

// A foot whose toes hang down by `pitch`, its ball where the flat foot's was.
void hang_toes(const Rig& rig, PlacedFoot& foot, double pitch) {
    const Measures& m = rig.measures();
    const Vec3 ball{m.foot_ball_x, 0, m.ball_height - m.ankle_height};
    const Vec3 ball_in_world = foot.ankle_in_world + foot.world_from_foot * ball;
    foot.world_from_foot = foot.world_from_foot * rotation_y(pitch);
    foot.ankle_in_world = ball_in_world - foot.world_from_foot * ball;
    foot.toe_extension = 0.5 * pitch;
}

// Countermovement jump: down, up with the arms, flight of 0.44 s, landing.
class Jump final : public Motion {
  public:
    explicit Jump(const Rig& rig) : rig_(rig) {}
    double period_s() const override { return 0; }
    Pose pose(double time_s) const override {
        static const KeyCurve kDepth{{0, 0},      {0.25, 0},    {0.62, 1}, {0.72, 1}, {0.95, 0.02},
                                     {1.36, 0.1}, {1.55, 0.75}, {2.05, 0}, {2.3, 0}};
        static const KeyCurve kArms{{0, 4},     {0.25, 4},  {0.58, -45}, {1.04, 140},
                                    {1.2, 148}, {1.65, 30}, {2.15, 4},   {2.3, 4}};
        constexpr double kOff_s = 0.95, kFlight_s = 0.44;
        const double t = std::fmod(time_s, 2.3), h = rig_.measures().stature, depth = kDepth(t);
        const double s = std::clamp((t - kOff_s) / kFlight_s, 0.0, 1.0);
        const double height = 0.5 * 9.81 * kFlight_s * kFlight_s * s * (1 - s);
        Pose pose;
        stand(rig_, pose, time_s, radians(3 + 44 * depth));
        pose.root_in_world += (-0.075 * h * depth) * kForward;
        pose.root_in_world.z += height - 0.20 * h * depth;
        std::array<PlacedFoot, 2> feet = feet_apart(rig_, 0.07 * h, radians(10), height);
        const double pitch = radians(38) * std::min(1.0, height / 0.05);
        for (PlacedFoot& foot : feet) hang_toes(rig_, foot, pitch);
        for (Side side : kSides)
            pose_arm(pose, side, radians(kArms(t)), radians(12), radians(-10), radians(22 + 10 * depth));
        put_on_feet(rig_, pose, feet, kFacing);
        return pose;
    }

  private:
    const Rig& rig_;
};

// A boxer's guard, left side in front: two straight lefts, a straight right, a left hook, weaving.
class Punch final : public Motion {
  public:
    explicit Punch(const Rig& rig) : rig_(rig) {}
    double period_s() const override { return 0; }
    Pose pose(double time_s) const override;

  private:
    const Rig& rig_;
};

Pose Punch::pose(double time_s) const {
    constexpr double kPeriod_s = 3.2;
    static const KeyCurve kLeft{{0.2, 0},  {0.42, 1}, {0.48, 1}, {0.72, 0},
                                {0.95, 0}, {1.15, 1}, {1.2, 1},  {1.45, 0}};
    static const KeyCurve kRight{{1.3, 0}, {1.58, 1}, {1.64, 1}, {1.95, 0}};
    static const KeyCurve kHook{{2.1, 0}, {2.38, 1}, {2.46, 1}, {2.8, 0}};
    const double t = std::fmod(time_s, kPeriod_s), h = rig_.measures().stature;
    const double left = kLeft(t), right = kRight(t), hook = kHook(t);
    const double weave = std::sin(2 * pi * 2 * t / kPeriod_s);
    Pose pose;
    stand(rig_, pose, 0, radians(10 + 5 * right));
    pose.root_in_world += (0.02 * h * (left + 1.6 * right) + 0.012 * h * weave) * kForward +
                          (0.02 * h * weave) * kLeftOfSubject;
    pose.root_in_world.z -= 0.045 * h + 0.012 * h * std::abs(weave);
    // The right shoulder is behind; a right straight and a hook turn the trunk.
    const double turn = radians(-38 - 8 * left + 62 * right + 6 * hook - 22 * hook);
    pose[kPelvis] = rotation_z(kFacing + 0.55 * turn) * rotation_y(radians(6));
    pose[kLumbar] = rotation_z(0.25 * turn) * rotation_y(radians(4));
    pose[kThorax] = rotation_z(0.20 * turn) * rotation_y(radians(3 + 6 * right));
    pose[kHead] = rotation_z(-0.85 * turn) * rotation_y(radians(6));
    for (Side side : kSides) {
        const double punch = side == Side::kLeft ? left : right, own_hook = side == Side::kLeft ? hook : 0;
        pose_arm(pose, side, radians(38 + 50 * punch + 42 * own_hook),
                 radians(10 + 4 * punch + 40 * own_hook), radians(-28 + 20 * punch - 25 * own_hook),
                 radians(122 - 112 * punch - 30 * own_hook));
    }
    std::array<PlacedFoot, 2> feet;
    const auto on_floor = [&](double ahead, double to_left) {
        Vec3 at = (ahead * h) * kForward + (to_left * h) * kLeftOfSubject;
        at.z = 0;
        return at;
    };
    feet[0] = flat_foot(rig_.measures(), on_floor(0.13, 0.06), kFacing + radians(-12));
    feet[1] = flat_foot(rig_.measures(), on_floor(-0.15, -0.075), kFacing + radians(-48));
    put_on_feet(rig_, pose, feet, kFacing + 0.4 * turn);
    return pose;
}

// Front kicks, right and left in turn: knee up, shank out, back, down.
class Kick final : public Motion {
  public:
    explicit Kick(const Rig& rig) : rig_(rig) {}
    double period_s() const override { return 0; }
    Pose pose(double time_s) const override;

  private:
    const Rig& rig_;
};

Pose Kick::pose(double time_s) const {
    constexpr double kPeriod_s = 3.4;
    static const KeyCurve kUp{{0.1, 0}, {0.5, 1}, {0.95, 1}, {1.4, 0}};
    static const KeyCurve kOut{{0.42, 0}, {0.68, 1}, {0.74, 1}, {0.98, 0}};
    const double t = std::fmod(time_s, kPeriod_s), h = rig_.measures().stature;
    const bool second = t >= 0.5 * kPeriod_s;
    const double own = second ? t - 0.5 * kPeriod_s : t, up = kUp(own), out = kOut(own);
    const Side side = second ? Side::kLeft : Side::kRight;
    const double s = sign_of(side);
    Pose pose;
    stand(rig_, pose, 0, radians(4 - 16 * out));
    // Over the standing leg.
    pose.root_in_world += (-0.035 * h * s * up) * kLeftOfSubject + (-0.03 * h * out) * kForward;
    pose.root_in_world.z -= 0.006 * h + 0.004 * h * up;
    pose[kPelvis] = rotation_z(kFacing + s * radians(-14) * out) * rotation_y(radians(-12 * out));
    pose[kLumbar] = pose[kLumbar] * rotation_z(s * radians(10) * out);
    std::array<PlacedFoot, 2> feet = feet_apart(rig_, 0.055 * h, radians(10));
    // The kicking foot by inverse kinematics: on the floor, at the raised knee, at the target.
    const Vec3 hip = pose.root_in_world + pose[kPelvis] * rig_.offset_in_parent(on_side(kThighL, side));
    const double leg = rig_.measures().leg();
    const Vec3 folded = hip + (0.34 * leg) * kForward + Vec3{0, 0, -0.34 * leg};
    const Vec3 stretched = hip + (0.93 * leg) * kForward + Vec3{0, 0, 0.10 * leg};
    PlacedFoot& foot = feet[side == Side::kRight];
    const double lift = up * up * (3 - 2 * up);
    foot.ankle_in_world =
        foot.ankle_in_world + lift * (folded + out * (stretched - folded) - foot.ankle_in_world);
    foot.world_from_foot =
        slerp(foot.world_from_foot, rotation_z(kFacing) * rotation_y(radians(20 - 75 * out)), lift);
    foot.in_contact = up <= 0;
    for (Side arm : kSides)
        pose_arm(pose, arm, radians(30 + 15 * up * (arm == side ? -1 : 1)), radians(14 + 14 * out),
                 radians(-24), radians(95 - 35 * out));
    put_on_feet(rig_, pose, feet, kFacing);
    return pose;
}

}  // namespace

std::unique_ptr<Motion> make_jump(const Rig& rig) {
    return std::make_unique<Jump>(rig);
}
std::unique_ptr<Motion> make_punch(const Rig& rig) {
    return std::make_unique<Punch>(rig);
}
std::unique_ptr<Motion> make_kick(const Rig& rig) {
    return std::make_unique<Kick>(rig);
}

}  // namespace kinevox::studio
