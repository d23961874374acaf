// Silhouettes of a recorded session, without any use of its calibration's places.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <vector>

#include "server/calibration/finding.h"
#include "server/calibration/silhouette_set.h"

namespace kinevox {

struct SessionSilhouettes {
    std::vector<Camera> cameras;
    SilhouetteSet set;
};

// About `moments` frame sets, evenly over the recording. Each camera's picture is searched as a whole; of
// what moves, the largest thing and what lies beside it counts.
absl::StatusOr<SessionSilhouettes> session_silhouettes(const std::filesystem::path& session_file, int moments,
                                                       const SolveProgress& progress);

}  // namespace kinevox
