// Videos or folders of pictures of a board, one a camera, and the board found in them.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "server/calibration/board_detector.h"
#include "server/calibration/finding.h"

namespace kinevox {

struct CameraClip {
    std::string camera;
    std::filesystem::path file;  // a video, a picture or a folder of pictures
    int width = 0, height = 0;   // px
};

// "cam_0=board/cam_0.mp4"; a name without '=' is a file named as its camera. Opens each to learn its size.
// InvalidArgument and NotFound name the argument.
absl::StatusOr<std::vector<CameraClip>> open_clips(const std::vector<std::string>& arguments);

// Every `every`-th picture of each clip, cameras side by side: sightings[camera][picture]; frame numbers are
// every * picture. Cancelled by `progress`.
absl::StatusOr<std::vector<std::vector<BoardSighting>>> find_boards(const std::vector<CameraClip>& clips,
                                                                    const BoardSpec& board, int every,
                                                                    const SolveProgress& progress);

}  // namespace kinevox
