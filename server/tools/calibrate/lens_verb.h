// Lenses from pictures of a board: what the verbs intrinsics and extrinsics share.
#pragma once

#include <absl/status/statusor.h>

#include <vector>

#include "server/calibration/board_clips.h"
#include "server/calibration/intrinsics.h"

namespace kinevox::calibrate {

using BoardSightings = std::vector<std::vector<BoardSighting>>;  // as find_boards() gives them

// Of each clip's camera. `every`: the step between the pictures looked at.
absl::StatusOr<std::vector<IntrinsicsResult>> solve_lenses(const std::vector<CameraClip>& clips,
                                                           const BoardSpec& board,
                                                           const BoardSightings& sightings, int every,
                                                           bool k3, const SolveProgress& progress);

void print_lenses(const std::vector<IntrinsicsResult>& lenses);

}  // namespace kinevox::calibrate
