// What a session with a person shows about its calibration: measurements with poses, and findings from them.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/calibration/finding.h"
#include "server/quality/measurements.h"

namespace kinevox::calibrate {

// Of the session's first frame sets with the given cameras; the body is fitted to the movement. Reads the
// videos a second time if cameras and silhouettes are inconsistent. The errors of the source and the
// pipeline; Cancelled by `progress`.
absl::StatusOr<quality::Measurements> measure_session(const std::filesystem::path& session_file,
                                                      const std::vector<Camera>& cameras,
                                                      const SolveProgress& progress);

// World frame, time, intrinsics and scale. `stature_m`: the subject's, if known.
std::vector<Finding> findings_of(const quality::Measurements& seen, const std::vector<Camera>& cameras,
                                 std::optional<double> stature_m);

}  // namespace kinevox::calibrate
