// Legs that the silhouettes lack: clothes of the floor's colour. In the fit they fold up, hide in the trunk
// or extend beyond the silhouettes.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/silhouette_rays.h"

namespace kinevox {

using LegFlags = std::array<bool, 2>;  // left, right

// What one frame set shows of the legs of a fitted body.
struct LegSight {
    // The ankle is outside most silhouettes, above the hip, or nearer to it than half of the leg's length,
    // and neither it nor the toe is seen near the floor (world z = 0).
    LegFlags lacking{};
    bool floats = false;  // no joint is seen near the floor

    bool none() const { return floats && lacking[0] && lacking[1]; }
};
LegSight see_legs(const BodyModel& model, const BodyPosture& posture, std::span<const SilhouetteRays> views);

// A body that floats without legs for longer is not one in a jump: both are missing. Each must then be seen
// for as long as kMinLegSeen_s to be back, since clothes like the background appear briefly.
inline constexpr double kMaxJump_s = 0.8, kMinLegSeen_s = 0.3;

// The legs that are missing, frame set by frame set.
class MissingLegs {
  public:
    LegFlags update(std::int64_t time_ns, const LegSight& sight);

  private:
    LegFlags missing_{};
    std::optional<std::int64_t> seen_ns_;                 // last time with a leg, or when tracking started
    std::array<std::optional<std::int64_t>, 2> back_ns_;  // when a missing leg was first seen again
};

// The same for a recording, before and after a body without legs alike. `time_s`: seconds, ascending; frame
// sets without a body have no sight.
std::vector<LegFlags> missing_legs(std::span<const std::optional<LegSight>> sights,
                                   std::span<const double> time_s);

}  // namespace kinevox
