// Feet that look like the floor are missing in the silhouettes: the legs get too short, and the body floats
// above the floor for longer than a person can.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "server/pose/body_model.h"

namespace kinevox {

// Indices of the frame sets, ascending in time, in which such a body should stand: those in which it is
// lowest, of each time that it floats. Higher than shoes and ankles whole legs are missing (missing_legs.h);
// then it need not stand. `stood`: this body's legs were found too short before; a part of that suffices.
std::vector<std::size_t> floating_frames(const BodyModel& model, std::span<const BodyPosture> postures,
                                         std::span<const std::int64_t> times_ns, bool stood);

}  // namespace kinevox
