// A sprint start on a lane along +x: "set" with the hands at x = 0, push-off, accelerating steps. Contact and
// flight times and step lengths are near those in Mero, Komi & Gregor, Biomechanics of sprint running, Sports
// Medicine 13 (1992), and Nagahara et al. (2014) for the first steps.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "server/cameras/studio/motion.h"

namespace kinevox::studio {
namespace {

using std::numbers::pi;
constexpr double kGo_s = 1.0;  // held in "set" until then
constexpr std::array<double, 9> kStance_s{0.20, 0.18, 0.165, 0.15, 0.14, 0.13, 0.125, 0.12, 0.12};
constexpr std::array<double, 9> kFlight_s{0.05, 0.05, 0.06, 0.07, 0.08, 0.09, 0.10, 0.105, 0.11};
constexpr double kRearOff_s = kGo_s + 0.17, kFrontOff_s = kGo_s + 0.36, kEnd_s = kGo_s + 2.22;

class SprintStart final : public Motion {
  public:
    explicit SprintStart(const Rig& rig) : rig_(rig), scale_(rig.measures().stature / 1.8) { plan_steps(); }
    double period_s() const override { return kEnd_s; }
    Pose pose(double time_s) const override;

  private:
    // Of the pelvis along the lane: v = top * (1 - exp(-t / tau)) as sprinters' velocity curves go, eased in.
    double travelled(double t) const {
        constexpr double kTau_s = 1.0, kDelay_s = 0.03;
        const double since = t - kGo_s - kDelay_s;
        const double start = -0.545 * scale_;
        if (since <= 0) return start;
        return start + 7.9 * scale_ * (since - kTau_s * (1 - std::exp(-since / kTau_s)));
    }
    void plan_steps();
    void pose_set_arms(Pose& pose) const;

    const Rig& rig_;
    double scale_;
    std::array<std::vector<Contact>, 2> contacts_;       // left (front foot), right (rear foot)
    std::vector<std::pair<double, double>> phase_keys_;  // time to stride phase; integers: left foot contact
};

void SprintStart::plan_steps() {
    const double u = scale_;
    Contact front{.on_s = -1,
                  .off_s = kFrontOff_s,
                  .ball_in_world = {-0.46 * u, 0.105 * u, 0},
                  .yaw = 0,
                  .strike_pitch = radians(42),
                  .off_pitch = radians(72),
                  .swing_lift_m = 0.10 * u};
    Contact rear{.on_s = -1,
                 .off_s = kRearOff_s,
                 .ball_in_world = {-0.84 * u, -0.105 * u, 0},
                 .yaw = 0,
                 .strike_pitch = radians(62),
                 .off_pitch = radians(78),
                 .swing_lift_m = 0.06 * u};
    contacts_[0].push_back(front);
    contacts_[1].push_back(rear);
    phase_keys_ = {{kGo_s, 0.12}, {kFrontOff_s, 0.42}};
    double on = kFrontOff_s + 0.06;
    for (std::size_t step = 0; step < 2 * kStance_s.size(); ++step) {
        const std::size_t row = std::min(step, kStance_s.size() - 1);
        const double progress = std::min(1.0, static_cast<double>(step) / 7.0);
        const double off = on + kStance_s[row], middle = 0.5 * (on + off);
        const bool right = step % 2 == 0;
        const double ahead =
            (-0.02 + 0.10 * progress) * u;  // ball of the foot ahead of the pelvis at mid stance
        contacts_[right].push_back(
            {.on_s = on,
             .off_s = off,
             .ball_in_world = {travelled(middle) + ahead, (right ? -1 : 1) * (0.09 - 0.05 * progress) * u, 0},
             .yaw = 0,
             .strike_pitch = radians(14 - 14 * progress),
             .off_pitch = radians(74),
             .flat_from = 0.25,
             .flat_until = 0.40,
             .swing_lift_m = (0.06 + 0.20 * progress) * u});
        phase_keys_.push_back({on, 0.5 + 0.5 * static_cast<double>(step)});
        on = off + kFlight_s[row];
    }
}

// In "set": hands on the line, a little wider than the shoulders, thumbs inwards, fingertips on the floor.
void SprintStart::pose_set_arms(Pose& pose) const {
    for (Side side : kSides) {
        const double s = sign_of(side);
        const Mat3 hand = rotation_x(s * radians(8)) * rotation_y(radians(8)) * rotation_z(-s * radians(80));
        const Vec3 tip{0.0, s * 0.27 * scale_, 0.006};
        const Vec3 wrist = tip - hand * Vec3{0, 0, -rig_.measures().hand};
        rig_.place_arm(pose, side, wrist, hand, {-0.5, s * 0.6, 0.1});
    }
}

Pose SprintStart::pose(double time_s) const {
    static const KeyCurve kLean{{0, 107},          {kGo_s, 107},      {kGo_s + 0.36, 62},
                                {kGo_s + 0.8, 40}, {kGo_s + 1.5, 17}, {kEnd_s, 9}};
    static const KeyCurve kHeight{
        {kGo_s, 0.455}, {kGo_s + 0.36, 0.490}, {kGo_s + 0.9, 0.500}, {kGo_s + 1.7, 0.512}};
    static const KeyCurve kTail{
        {kGo_s, 0.80}, {kGo_s + 0.5, 0.62}, {kGo_s + 1.6, 0.8}};  // fraction of the lean at the pelvis
    static const KeyCurve kRunning{{kGo_s + 0.02, 0}, {kGo_s + 0.30, 1}};
    static const KeyCurve kSwing{{kGo_s, 30}, {kGo_s + 0.3, 58}, {kGo_s + 1.6, 46}};
    const double t = std::fmod(time_s, kEnd_s), running = kRunning(t);
    const KeyCurve phase_curve(phase_keys_);
    const double phase = 2 * pi * phase_curve(t);

    Pose pose;
    const double breath = (1 - running) * 0.004 * std::sin(2 * pi * 0.4 * t);
    const double bob = running * 0.022 * scale_ * std::cos(2 * phase - 4 * pi * 0.43);
    pose.root_in_world = {travelled(t), 0, kHeight(t) * rig_.measures().stature + bob + breath};
    const double lean = radians(kLean(t)), pelvis_lean = kTail(t) * lean;
    const double turn = -running * radians(9) * std::cos(phase),
                 list = running * radians(4) * std::cos(phase - 0.4 * pi);
    pose[kPelvis] = rotation_z(turn) * rotation_y(pelvis_lean) * rotation_x(list);
    pose[kLumbar] =
        rotation_x(-0.6 * list) * rotation_y(0.55 * (lean - pelvis_lean)) * rotation_z(-0.9 * turn);
    pose[kThorax] =
        rotation_x(-0.4 * list) * rotation_y(0.45 * (lean - pelvis_lean)) * rotation_z(-0.9 * turn);
    pose[kNeck] = rotation_y(-0.05 * lean) * rotation_z(0.5 * turn);
    pose[kHead] = rotation_y(-0.22 * lean) * rotation_z(0.3 * turn);

    std::array<PlacedFoot, 2> feet;
    for (Side side : kSides) {
        const std::vector<Contact>& plan = contacts_[side == Side::kRight];
        std::size_t i = 0;
        while (i + 2 < plan.size() && plan[i + 1].on_s <= t) ++i;
        Contact current = plan[i];
        if (i == 0) {  // on the ball from the beginning, heel up; pushes off after "go"
            current.flat_from = 0;
            current.on_s = kGo_s;
            current.flat_until = 0;
            const double s = std::clamp((t - kGo_s) / (current.off_s - kGo_s), 0.0, 1.0);
            Contact held = current;
            held.off_pitch = current.strike_pitch + (current.off_pitch - current.strike_pitch) * s * s;
            if (t < current.off_s) {  // evaluated at the end of a stance that ends now
                held.off_s = std::max(t, kGo_s) + 1e-9;
                held.on_s = held.off_s - 1;
                feet[side == Side::kRight] = place_foot(rig_.measures(), held, plan[1], held.off_s - 1e-12);
                continue;
            }
        }
        feet[side == Side::kRight] = place_foot(rig_.measures(), current, plan[i + 1], t);
    }
    put_on_feet(rig_, pose, feet, 0);

    pose_set_arms(pose);
    if (running > 0) {
        Pose swinging = pose;
        for (Side side : kSides) {
            const double swing = -sign_of(side) * std::cos(phase + 0.2);
            pose_arm(swinging, side, 0.35 * lean + radians(-4 + kSwing(t) * swing), radians(10), radians(-22),
                     radians(88 + 18 * swing));
            for (Bone left : {kClavicleL, kUpperArmL, kForearmL, kHandL}) {
                const Bone bone = on_side(left, side);
                pose[bone] = slerp(pose[bone], swinging[bone], running);
            }
        }
    }
    return pose;
}

}  // namespace

std::unique_ptr<Motion> make_sprint_start(const Rig& rig) {
    return std::make_unique<SprintStart>(rig);
}

}  // namespace kinevox::studio
