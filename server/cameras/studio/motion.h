// Motions of the virtual studio's person: a pose for every time; and what they are made of.
#pragma once

#include <absl/status/statusor.h>

#include <initializer_list>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/geometry.h"
#include "server/cameras/studio/motion_names.h"
#include "server/cameras/studio/rig.h"

namespace kinevox::studio {

enum class Stage {
    kRoom,
    kLane
};  // a room of 10 m x 9 m about the origin; a hall with a lane, x 0..12, y -1..1

class Motion {
  public:
    virtual ~Motion() = default;
    // Any time >= 0; continuous except at the end of each period if period_s() > 0.
    virtual Pose pose(double time_s) const = 0;
    // Time after which the motion restarts with a jump in position; 0: it never jumps.
    virtual double period_s() const = 0;
};

// The stage that suits the motion.
Stage natural_stage(std::string_view motion);

// InvalidArgument for an unknown name. `rig` must outlive the motion.
absl::StatusOr<std::unique_ptr<Motion>> make_motion(std::string_view name, Stage stage, const Rig& rig);

// Factories.
std::unique_ptr<Motion> make_gait(bool run, Stage stage, const Rig& rig);  // gait_motion.cc
std::unique_ptr<Motion> make_sprint_start(const Rig& rig);                 // sprint_motion.cc
std::unique_ptr<Motion> make_squat(const Rig& rig);                        // exercise_motions.cc
std::unique_ptr<Motion> make_jumping_jack(const Rig& rig);
std::unique_ptr<Motion> make_arm_raise(const Rig& rig);
std::unique_ptr<Motion> make_stand(const Rig& rig);
std::unique_ptr<Motion> make_jump(const Rig& rig);  // combat_motions.cc, with the two that follow
std::unique_ptr<Motion> make_punch(const Rig& rig);
std::unique_ptr<Motion> make_kick(const Rig& rig);
std::unique_ptr<Motion> make_get_up(const Rig& rig);  // floor_motion.cc

// A smooth curve through (time, value) keys that never overshoots them: monotone cubic Hermite after Fritsch
// & Carlson. Constant before the first and after the last key.
class KeyCurve {
  public:
    KeyCurve(std::initializer_list<std::pair<double, double>> keys) : KeyCurve(std::vector(keys)) {}
    explicit KeyCurve(std::vector<std::pair<double, double>> keys)
        : keys_(std::move(keys)), slope_(keys_.size(), 0) {
        for (std::size_t i = 1; i + 1 < keys_.size(); ++i) {
            const double before = rate(i - 1), after = rate(i);
            if (before * after > 0) slope_[i] = 2 * before * after / (before + after);
        }
    }
    double operator()(double t) const {
        if (t <= keys_.front().first) return keys_.front().second;
        if (t >= keys_.back().first) return keys_.back().second;
        std::size_t i = 0;
        while (keys_[i + 1].first <= t) ++i;
        const double h = keys_[i + 1].first - keys_[i].first, s = (t - keys_[i].first) / h;
        const double a = keys_[i].second, b = keys_[i + 1].second;
        return a + (b - a) * s * s * (3 - 2 * s) +
               h * s * (1 - s) * ((1 - s) * slope_[i] - s * slope_[i + 1]);
    }

  private:
    double rate(std::size_t i) const {
        return (keys_[i + 1].second - keys_[i].second) / (keys_[i + 1].first - keys_[i].first);
    }
    std::vector<std::pair<double, double>> keys_;
    std::vector<double> slope_;
};

// What exercises in place share: the subject faces kFacing, so that no limb lies in an axis plane of the
// world.
inline constexpr double kFacing = 20 * 3.14159265358979323846 / 180;
inline const Vec3 kLeftOfSubject{-0.34202014332566873, 0.9396926207859084, 0};

// Trunk and head breathe and sway a little, never quite still.
void stand(const Rig& rig, Pose& pose, double t, double lean);
std::array<struct PlacedFoot, 2> feet_apart(const Rig& rig, double half_width_m, double out,
                                            double height_m = 0);

// Feet without sliding: a foot is planned as contacts with the floor, rolls over heel and ball while in
// contact and swings in between. Legs follow by inverse kinematics.

// One stance of one foot. Pitch: radians about the foot's left axis, positive lifts the heel.
struct Contact {
    double on_s = 0, off_s = 0;
    Vec3 ball_in_world;       // on the floor under the ball of the foot
    double yaw = 0;           // of the foot's forward axis, radians
    double strike_pitch = 0;  // at on_s; negative: heel first; positive: ball first
    double off_pitch = 0;     // at off_s
    double flat_from = 0.15;  // fractions of the stance between which the foot is flat
    double flat_until = 0.5;
    double swing_lift_m = 0.05;  // extra height of the ankle in the swing that follows
};

struct PlacedFoot {
    Vec3 ankle_in_world;
    Mat3 world_from_foot;
    double toe_extension = 0;  // radians, toes up against the foot
    bool in_contact = false;
};

// The foot at time t; current.on_s <= t < next.on_s.
PlacedFoot place_foot(const Measures& measures, const Contact& current, const Contact& next, double t);

// A foot flat on the floor with its ankle above (x, y).
PlacedFoot flat_foot(const Measures& measures, Vec3 ankle_on_floor, double yaw);

// Bends both legs to the placed feet; lowers the pelvis where a standing leg would be too short. `yaw`:
// direction of the knees.
void put_on_feet(const Rig& rig, Pose& pose, const std::array<PlacedFoot, 2>& feet, double yaw);

// Arm angles in radians (see limb_rotation()); the shoulder girdle follows arms raised above 40 degrees.
void pose_arm(Pose& pose, Side side, double flexion, double abduction, double external_rotation,
              double elbow);

}  // namespace kinevox::studio
