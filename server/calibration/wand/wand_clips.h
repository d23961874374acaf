// The wand detected in videos, one per camera.
#pragma once

#include <absl/status/statusor.h>

#include <vector>

#include "server/calibration/board/board_clips.h"
#include "server/calibration/wand/wand.h"

namespace kinevox {

// Cameras in parallel: detections[camera][image]. The background is the clip's background, or the median of
// some of its own images. Cancelled by `progress`.
struct WandImage {
    WandDetection wand;
    double changed = 0;  // see changed_fraction()
};
absl::StatusOr<std::vector<std::vector<WandImage>>> detect_wands(const std::vector<CameraClip>& clips,
                                                                 const WandSpec& wand,
                                                                 const ClipImages& which,
                                                                 const SolveProgress& progress);

}  // namespace kinevox
