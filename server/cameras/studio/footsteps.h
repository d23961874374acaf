// Feet without sliding: a foot is planned as contacts with the floor, rolls over heel and ball while in
// contact and swings in between. Legs follow by inverse kinematics.
#pragma once

#include <utility>

#include "common/degrees.h"
#include "server/cameras/studio/rig.h"

namespace kinevox::studio {

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
