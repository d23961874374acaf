// The wand found in videos, one a camera.
#pragma once

#include <absl/status/statusor.h>

#include <vector>

#include "server/calibration/board_clips.h"
#include "server/calibration/wand.h"

namespace kinevox {

// Cameras side by side: sightings[camera][picture]. The empty scene is
// the clip's background, or else the median of some of its own pictures. Cancelled by `progress`.
struct WandPicture {
    WandSighting wand;
    double changed = 0;  // see changed_part()
};
absl::StatusOr<std::vector<std::vector<WandPicture>>> find_wands(const std::vector<CameraClip>& clips,
                                                                 const WandSpec& wand,
                                                                 const ClipPictures& which,
                                                                 const SolveProgress& progress);

}  // namespace kinevox
