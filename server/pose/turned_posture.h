// Other readings of a body's silhouettes: the same body facing the other way, an elbow on the other side, or
// a forearm farther from a camera.
#pragma once

#include <array>
#include <optional>
#include <utility>

#include "server/pose/body_model.h"

namespace kinevox {

// The segments of both limbs of a kind, left and right.
using LimbSegmentPairs = std::array<std::pair<int, int>, 3>;
inline constexpr LimbSegmentPairs kLegSegments{{{kThighL, kThighR}, {kShankL, kShankR}, {kFootL, kFootR}}},
    kArmSegments{{{kUpperArmL, kUpperArmR}, {kForearmL, kForearmR}, {kHandL, kHandR}}};

BodyPosture exchanged(BodyPosture posture, const LimbSegmentPairs& limbs);

// Trunk and head rotated by half a turn about their long axes, left and right exchanged. Arms stay where they
// are, hips and ankles nearly so; knees and feet point forwards again, that is, the other way. Of an upright
// body the silhouettes hardly differ, so a tracker that starts with the wrong one does not notice until the
// knees bend.
BodyPosture turned(const BodyModel& model, const BodyPosture& posture);

// Half a turn of an arm about the line from shoulder to wrist, the hand straight: the elbow bends to the
// other side. `upper_arm` is kUpperArmL or kUpperArmR.
BodyPosture elbow_mirrored(const BodyModel& model, const BodyPosture& posture, int upper_arm);

// Turns a forearm, kForearmL or kForearmR, about its elbow away from a viewpoint by an angle (rad, negative:
// towards it), the hand straight: the upper arm rotates about its own axis, and the elbow bends. From there
// the forearm keeps its direction in the image. Empty beyond the viewing ray through the elbow.
std::optional<BodyPosture> forearm_turned(const BodyModel& model, const BodyPosture& posture, int forearm,
                                          Vec3 viewpoint_in_world, double angle);

// Rotates an arm about the line from shoulder to wrist by `angle` (rad): the elbow moves around that line.
BodyPosture elbow_swivelled(const BodyModel& model, const BodyPosture& posture, int upper_arm, double angle);

// Rotates an upper arm about its own axis by `twist` and bends its elbow further by `bend` (rad): the
// forearm, kForearmL or kForearmR, points anywhere else. The elbow bends between 0 and kMaxBend_rad.
BodyPosture forearm_moved(BodyPosture posture, int forearm, double twist, double bend);

// Rotation of the upper arm about its own axis against the hanging arm, after the shortest swing; -pi to pi.
// Beyond about half of that range no shoulder turns.
double upper_arm_twist(const BodyPosture& posture, int upper_arm);

}  // namespace kinevox
