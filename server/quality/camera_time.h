// Whether the videos of a session are aligned in time.
#pragma once

#include <optional>

#include "common/session_file.h"
#include "server/quality/measurements.h"

namespace kinevox::quality {

// The camera whose images are most out of step with the others', from the motion of the silhouettes in all
// images; empty if that motion does not determine it. Reads all videos: only if something is inconsistent.
std::optional<RigHypothesis> measure_camera_time(const Session& session);

}  // namespace kinevox::quality
