// Certificates of solved calibrations, and their world frame.
#pragma once

#include <absl/status/statusor.h>

#include <span>
#include <string>
#include <vector>

#include "server/calibration/board/extrinsics.h"
#include "server/calibration/board/intrinsics.h"
#include "server/calibration/certificate/certificate.h"

namespace kinevox {

// Defines the world frame by a board on the floor: origin at its lower left corner, z up. `lying`: frame sets
// in which it lies there; the first solved one counts, averaged with the neighbours in which the board rests.
// FailedPrecondition if none was solved.
absl::Status define_world_by_board(std::span<const int> lying, ExtrinsicsResult& result);

// Inherits the world frame of cameras at about the same positions: rigid, no scale. Adds a finding with the
// remaining distance; false, and no change, if the positions differ too much.
bool inherit_world(const std::vector<Camera>& like, ExtrinsicsResult& result);

// The cameras have intrinsics only.
Certificate intrinsics_certificate(std::vector<IntrinsicsResult> results);

// `method` as in Certificate. With `world_defined` the world frame is checked, too.
Certificate extrinsics_certificate(const std::string& method, ExtrinsicsResult result, bool world_defined);

}  // namespace kinevox
