// Silhouettes of the subject of a session.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <string>
#include <vector>

#include "server/calibration/finding.h"
#include "server/pipeline/frame_result.h"
#include "server/silhouettes/silhouettes.h"

namespace kinevox {

struct SessionSilhouettes {
    std::vector<Camera> cameras;
    SilhouetteSet set;
};

// The tracked subject's silhouette in each camera; for an untracked camera that was segmented over the full
// image, the largest moving component and its neighbours. Empty masks otherwise.
std::vector<SilhouetteMask> silhouettes_of(const FrameResult& result, const std::vector<Camera>& cameras);

// About `frame_sets` frame sets, evenly over the session, from the pipeline's segmentation and tracking: the
// volume separates the subject from shadows and other motion. Cameras that the tracker excludes because of a
// wrong pose are segmented over the full image; the largest moving component and its neighbours count.
// `cameras`: the session's, in its order, with their current calibration.
absl::StatusOr<SilhouetteSet> tracked_silhouettes(const std::filesystem::path& session_file,
                                                  const std::vector<Camera>& cameras, int frame_sets,
                                                  const SolveProgress& progress);

// The same without extrinsics: every full image is segmented by itself.
absl::StatusOr<SilhouetteSet> untracked_silhouettes(const std::filesystem::path& session_file, int frame_sets,
                                                    const SolveProgress& progress);

// The session's cameras, from `calibration_file` unless it is empty.
absl::StatusOr<std::vector<Camera>> session_cameras(const std::filesystem::path& session_file,
                                                    const std::string& calibration_file);

// session_cameras() and their tracked_silhouettes().
absl::StatusOr<SessionSilhouettes> session_silhouettes(const std::filesystem::path& session_file,
                                                       int frame_sets, const std::string& calibration_file,
                                                       const SolveProgress& progress);

}  // namespace kinevox
