// Exercises in place: squat, jumping jack, arm raise. Endless and periodic.
#include <cmath>
#include <numbers>

#include "server/cameras/studio/motion.h"

namespace kinevox::studio {
namespace {

using std::numbers::pi;

}  // namespace

void stand(const Rig& rig, Pose& pose, double t, double lean) {
    const double sway = 0.012 * std::sin(2 * pi * 0.23 * t), breath = 0.010 * std::sin(2 * pi * 0.27 * t);
    pose.root_in_world = {0, 0, rig.measures().standing_root_z() - 0.006};
    pose.root_in_world += 0.5 * sway * kLeftOfSubject;
    pose[kPelvis] = rotation_z(kFacing) * rotation_x(-0.3 * sway) * rotation_y(0.6 * lean);
    pose[kLumbar] = rotation_y(0.3 * lean) * rotation_x(sway);
    pose[kThorax] = rotation_y(0.1 * lean - breath);
    pose[kNeck] = rotation_y(radians(8) - 0.2 * lean);
    pose[kHead] = rotation_y(radians(-7) - 0.35 * lean) * rotation_z(0.05 * std::sin(2 * pi * 0.11 * t));
}

std::array<PlacedFoot, 2> feet_apart(const Rig& rig, double half_width_m, double out, double height_m) {
    std::array<PlacedFoot, 2> feet;
    for (Side side : kSides) {
        const double s = sign_of(side);
        Vec3 floor = s * half_width_m * kLeftOfSubject;
        floor.z = height_m;
        feet[side == Side::kRight] = flat_foot(rig.measures(), floor, kFacing + s * out);
    }
    return feet;
}

namespace {

class Squat final : public Motion {
  public:
    explicit Squat(const Rig& rig) : rig_(rig) {}
    double period_s() const override { return 0; }
    Pose pose(double time_s) const override {
        static const KeyCurve kDepth{{0, 0}, {0.35, 0}, {1.45, 1}, {1.75, 1}, {2.75, 0}, {3.2, 0}};
        const double depth = kDepth(std::fmod(time_s, 3.2)), h = rig_.measures().stature;
        Pose pose;
        stand(rig_, pose, time_s, radians(4 + 46 * depth));
        const Vec3 forward = rotation_z(kFacing) * Vec3{1, 0, 0};
        pose.root_in_world += (-0.115 * h * depth) * forward;
        pose.root_in_world.z -= 0.245 * h * depth;
        for (Side side : kSides)
            pose_arm(pose, side, radians(4 + 100 * depth), radians(8 - 4 * depth), radians(-10),
                     radians(12 - 4 * depth));
        put_on_feet(rig_, pose, feet_apart(rig_, 0.100 * h, radians(16)), kFacing);
        return pose;
    }

  private:
    const Rig& rig_;
};

class JumpingJack final : public Motion {
  public:
    explicit JumpingJack(const Rig& rig) : rig_(rig) {}
    double period_s() const override { return 0; }
    Pose pose(double time_s) const override {
        // Stand closed, hop apart, stand open, hop together.
        static const KeyCurve kOpen{{0, 0}, {0.16, 0}, {0.48, 1}, {0.66, 1}, {0.98, 0}, {1.1, 0}};
        static const KeyCurve kArms{{0, 0}, {0.08, 0}, {0.52, 1}, {0.60, 1}, {1.04, 0}, {1.1, 0}};
        static const KeyCurve kKnees{{0, 0.6},  {0.05, 1},   {0.17, 0.1}, {0.32, 0.0}, {0.47, 0.2},
                                     {0.57, 1}, {0.67, 0.1}, {0.82, 0.0}, {0.97, 0.2}, {1.1, 0.6}};
        const double t = std::fmod(time_s, 1.1), open = kOpen(t), arms = kArms(t),
                     h = rig_.measures().stature;
        const auto hop = [&](double from) {
            const double s = (t - from) / 0.32;
            return s > 0 && s < 1 ? 0.075 * 4 * s * (1 - s) : 0.0;
        };
        const double height = hop(0.16) + hop(0.66);
        Pose pose;
        stand(rig_, pose, time_s, radians(3 + 5 * kKnees(t)));
        const double half_width = (0.045 + 0.135 * open) * h;
        const double spread = std::max(0.0, half_width - rig_.measures().hip_half_width),
                     leg = rig_.measures().leg();
        pose.root_in_world.z +=
            height - (leg - std::sqrt(leg * leg - spread * spread)) - 0.012 - 0.035 * kKnees(t);
        for (Side side : kSides)
            pose_arm(pose, side, radians(4), radians(10 + 155 * arms), radians(-10 + 40 * arms),
                     radians(18 + 10 * arms));
        std::array<PlacedFoot, 2> feet = feet_apart(rig_, half_width, radians(8 + 8 * open), height);
        for (PlacedFoot& foot : feet) {  // toes hang in the air
            const double pitch = radians(32) * std::min(1.0, height / 0.06);
            const Vec3 ball{rig_.measures().foot_ball_x, 0,
                            rig_.measures().ball_height - rig_.measures().ankle_height};
            const Vec3 ball_in_world = foot.ankle_in_world + foot.world_from_foot * ball;
            foot.world_from_foot = foot.world_from_foot * rotation_y(pitch);
            foot.ankle_in_world = ball_in_world - foot.world_from_foot * ball;
            foot.toe_extension = 0.6 * pitch;
        }
        put_on_feet(rig_, pose, feet, kFacing);
        return pose;
    }

  private:
    const Rig& rig_;
};

class ArmRaise final : public Motion {
  public:
    explicit ArmRaise(const Rig& rig) : rig_(rig) {}
    double period_s() const override { return 0; }
    Pose pose(double time_s) const override {
        // Both forward and up, both sideways to the horizontal, then one after the other to the side and up.
        static const KeyCurve kFlexion{{0, 3}, {0.3, 3}, {1.6, 168}, {2.0, 168}, {3.2, 3}, {10, 3}};
        static const KeyCurve kBoth{{3.4, 0}, {4.4, 84}, {4.8, 84}, {5.7, 0}};
        static const KeyCurve kLeft{{5.9, 0}, {6.9, 150}, {7.1, 150}, {8.0, 0}};
        static const KeyCurve kRight{{7.7, 0}, {8.7, 150}, {8.9, 150}, {9.8, 0}};
        const double t = std::fmod(time_s, 10.0);
        Pose pose;
        stand(rig_, pose, time_s, radians(2));
        for (Side side : kSides) {
            const double abduction = 8 + kBoth(t) + (side == Side::kLeft ? kLeft(t) : kRight(t));
            pose_arm(pose, side, radians(kFlexion(t)), radians(abduction),
                     radians(-6 + 0.3 * (abduction - 8)), radians(9));
        }
        pose[kLumbar] = pose[kLumbar] * rotation_x(radians(-0.03 * (kLeft(t) - kRight(t))));
        put_on_feet(rig_, pose, feet_apart(rig_, 0.062 * rig_.measures().stature, radians(9)), kFacing);
        return pose;
    }

  private:
    const Rig& rig_;
};

// At ease: the arms hang at the trunk, the weight shifts from leg to leg, the head looks around.
class Stand final : public Motion {
  public:
    explicit Stand(const Rig& rig) : rig_(rig) {}
    double period_s() const override { return 0; }
    Pose pose(double time_s) const override {
        const double shift = std::sin(2 * pi * 0.19 * time_s), h = rig_.measures().stature;
        Pose pose;
        stand(rig_, pose, time_s, radians(3 + 2 * std::sin(2 * pi * 0.07 * time_s)));
        pose.root_in_world += 0.016 * h * shift * kLeftOfSubject;
        pose[kPelvis] = pose[kPelvis] * rotation_x(radians(2.5) * shift);
        pose[kLumbar] = pose[kLumbar] * rotation_x(radians(-2) * shift);
        pose[kHead] = pose[kHead] * rotation_z(radians(28) * std::sin(2 * pi * 0.13 * time_s));
        for (Side side : kSides)
            pose_arm(pose, side, radians(3 + 3 * std::sin(2 * pi * 0.29 * time_s + (side == Side::kLeft))),
                     radians(5 + 1.5 * shift), radians(-12), radians(10 + 4 * shift));
        put_on_feet(rig_, pose, feet_apart(rig_, 0.060 * h, radians(10)), kFacing);
        return pose;
    }

  private:
    const Rig& rig_;
};

}  // namespace

std::unique_ptr<Motion> make_stand(const Rig& rig) {
    return std::make_unique<Stand>(rig);
}
std::unique_ptr<Motion> make_squat(const Rig& rig) {
    return std::make_unique<Squat>(rig);
}
std::unique_ptr<Motion> make_jumping_jack(const Rig& rig) {
    return std::make_unique<JumpingJack>(rig);
}
std::unique_ptr<Motion> make_arm_raise(const Rig& rig) {
    return std::make_unique<ArmRaise>(rig);
}

}  // namespace kinevox::studio
