// Lies on the back with the knees bent, sits up, rocks over the feet and stands up; then the same backwards.
#include <algorithm>
#include <cmath>

#include "server/cameras/studio/motion.h"

namespace kinevox::studio {
namespace {

class GetUp final : public Motion {
  public:
    explicit GetUp(const Rig& rig) : rig_(rig) {}
    double period_s() const override { return 0; }
    Pose pose(double time_s) const override;

  private:
    double lowest_of_trunk(const Pose& pose) const;
    const Rig& rig_;
};

// Height of the trunk's lowest point above the floor, from balls at its back.
double GetUp::lowest_of_trunk(const Pose& pose) const {
    const Measures& m = rig_.measures();
    const double u = m.stature / 1.8, g = m.girth, k = m.trunk_scale;
    const PosedRig posed = rig_.forward(pose);
    struct Ball {
        Bone bone;
        Vec3 at;
        double radius;
    };
    const std::array<Ball, 6> balls{{{kPelvis, {-0.040, 0.072, -0.030 * k}, 0.081 * g + 0.016},
                                     {kPelvis, {-0.040, -0.072, -0.030 * k}, 0.081 * g + 0.016},
                                     {kThorax, {-0.055, 0.075, 0.17 * k}, 0.063 * g + 0.008},
                                     {kThorax, {-0.055, -0.075, 0.17 * k}, 0.063 * g + 0.008},
                                     {kThorax, {-0.025, 0.10, 0.205 * k}, 0.062 * g + 0.008},
                                     {kHead, {-0.010, 0, 0.062}, 0.100}}};
    double lowest = 1e9;
    for (const Ball& ball : balls)
        lowest = std::min(
            lowest, (posed.world_from_bone[ball.bone] * (rig_.flesh_in_bone(ball.bone) + u * ball.at)).z -
                        u * ball.radius);
    return lowest;
}

Pose GetUp::pose(double time_s) const {
    // 0: lies; 1: sits; 2: crouches; 3: stands.
    static const KeyCurve kPhase{{0, 0},   {0.7, 0}, {1.7, 1}, {1.9, 1}, {2.7, 2}, {2.85, 2}, {3.8, 3},
                                 {4.6, 3}, {5.6, 2}, {5.7, 2}, {6.5, 1}, {6.7, 1}, {7.8, 0},  {8.2, 0}};
    static const KeyCurve kPelvisPitch{{0, -86}, {1, -30}, {2, -5}, {3, 3}};
    static const KeyCurve kTrunkPitch{{0, 3}, {0.4, 22}, {1, 26}, {2, 60}, {3, 2}};
    static const KeyCurve kNeckPitch{{0, 12}, {0.3, 28}, {1, 5}, {2, -30}, {3, 0}};
    static const KeyCurve kBehind{
        {0, 0.345}, {1, 0.310}, {2, 0.170}, {3, 0.0}};  // of the root behind the feet
    static const KeyCurve kArm{{0, 10}, {0.5, 55}, {1, 62}, {2, 102}, {3, 4}};
    static const KeyCurve kElbow{{0, 14}, {1, 20}, {2, 24}, {3, 12}};
    const double t = std::fmod(time_s, 8.2), phase = kPhase(t), h = rig_.measures().stature;
    // Height of the root, from sitting on.
    const KeyCurve up_m({{1, 0}, {2, 0.26 * h}, {3, rig_.measures().standing_root_z() - 0.008}});
    const Vec3 forward = rotation_z(kFacing) * Vec3{1, 0, 0};
    Pose pose;
    pose.root_in_world = (0.12 * h - kBehind(phase) * h) * forward;
    pose[kPelvis] = rotation_z(kFacing) * rotation_y(radians(kPelvisPitch(phase)));
    pose[kLumbar] = rotation_y(radians(0.55 * kTrunkPitch(phase)));
    pose[kThorax] = rotation_y(radians(0.45 * kTrunkPitch(phase)));
    pose[kNeck] = rotation_y(radians(0.5 * kNeckPitch(phase) + 4));
    pose[kHead] = rotation_y(radians(0.5 * kNeckPitch(phase) - 4));
    pose.root_in_world.z = up_m(phase);
    const double resting = pose.root_in_world.z - lowest_of_trunk(pose);
    if (phase <= 1) pose.root_in_world.z = resting;
    if (phase > 1 && phase < 2) {  // takes off from the floor
        const double s = phase - 1, eased = s * s * (3 - 2 * s);
        pose.root_in_world.z = std::max(resting, (1 - eased) * resting + eased * pose.root_in_world.z);
    }
    for (Side side : kSides)
        pose_arm(pose, side, radians(kArm(phase)), radians(14 - 3 * std::min(phase, 2.0)), radians(-8),
                 radians(kElbow(phase)));
    std::array<PlacedFoot, 2> feet = feet_apart(rig_, 0.075 * h, radians(10));
    for (PlacedFoot& foot : feet) foot.ankle_in_world += (0.12 * h) * forward;
    put_on_feet(rig_, pose, feet, kFacing);
    return pose;
}

}  // namespace

std::unique_ptr<Motion> make_get_up(const Rig& rig) {
    return std::make_unique<GetUp>(rig);
}

}  // namespace kinevox::studio
