// The other reading of a body's silhouettes: the same body facing the other way.
#pragma once

#include <array>
#include <utility>

#include "server/pose/body_model.h"

namespace kinevox {

// The segments of both limbs of a kind, left and right.
using LimbSegmentPairs = std::array<std::pair<int, int>, 3>;
inline constexpr LimbSegmentPairs kLegSegments{{{kThighL, kThighR}, {kShankL, kShankR}, {kFootL, kFootR}}},
    kArmSegments{{{kUpperArmL, kUpperArmR}, {kForearmL, kForearmR}, {kHandL, kHandR}}};

// Trunk and head rotated by half a turn about their long axes, left and right exchanged. Arms stay where they
// are, hips and ankles nearly so; knees and feet point forwards again, that is, the other way. Of an upright
// body the silhouettes hardly differ, so a tracker that starts with the wrong one does not notice until the
// knees bend.
BodyPosture turned(const BodyModel& model, const BodyPosture& posture);

}  // namespace kinevox
