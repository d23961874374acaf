// Intrinsics from images of a board: shared by the commands intrinsics and extrinsics.
#pragma once

#include <absl/status/statusor.h>

#include <vector>

#include "server/calibration/board/board_clips.h"
#include "server/calibration/board/intrinsics.h"
#include "server/tools/calibrate/certificate_files.h"

namespace kinevox::calibrate {

using BoardDetections = std::vector<std::vector<BoardDetection>>;  // see detect_boards()

// One result per clip. `stride`: step between the images.
absl::StatusOr<std::vector<IntrinsicsResult>> solve_intrinsics(const std::vector<CameraClip>& clips,
                                                               const BoardSpec& board,
                                                               const BoardDetections& detections, int stride,
                                                               bool k3, const SolveProgress& progress);

void print_intrinsics(const std::vector<IntrinsicsResult>& results, const Output& output);

}  // namespace kinevox::calibrate
