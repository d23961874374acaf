// Silhouettes of the subject of a recorded session.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <string>
#include <vector>

#include "server/calibration/finding.h"
#include "server/calibration/silhouette_set.h"
#include "server/pipeline/frame_result.h"

namespace kinevox {

struct SessionSilhouettes {
    std::vector<Camera> cameras;
    SilhouetteSet set;
};

// What the tracked subject covers in each camera's picture; where a camera is not tracked but was searched as
// a whole, the largest thing that moves there and what lies beside it. Empty pictures where neither can be
// told.
std::vector<SilhouettePicture> silhouettes_of(const FrameResult& result, const std::vector<Camera>& cameras);

// About `moments` frame sets, evenly over the recording, from the pipeline's own segmentation and tracking:
// the volume tells what belongs to the subject and what is a shadow or moves elsewhere. Cameras whose place
// is so wrong that the tracker leaves them out are searched as a whole; of what moves there, the largest
// thing and what lies beside it counts. `cameras`: of the session, in its order, as they are believed to
// stand.
absl::StatusOr<SilhouetteSet> tracked_silhouettes(const std::filesystem::path& session_file,
                                                  const std::vector<Camera>& cameras, int moments,
                                                  const SolveProgress& progress);

// The same without any use of the cameras' places: every picture is searched as a whole.
absl::StatusOr<SilhouetteSet> untracked_silhouettes(const std::filesystem::path& session_file, int moments,
                                                    const SolveProgress& progress);

// The session's cameras, from `calibration_file` where it is not empty.
absl::StatusOr<std::vector<Camera>> session_cameras(const std::filesystem::path& session_file,
                                                    const std::string& calibration_file);

// session_cameras() and their tracked_silhouettes().
absl::StatusOr<SessionSilhouettes> session_silhouettes(const std::filesystem::path& session_file, int moments,
                                                       const std::string& calibration_file,
                                                       const SolveProgress& progress);

}  // namespace kinevox
