// From what was solved to a certificate, and the world that solved places stand in.
#pragma once

#include <absl/status/statusor.h>

#include <span>
#include <string>
#include <vector>

#include "server/calibration/certificate.h"
#include "server/calibration/extrinsics.h"
#include "server/calibration/intrinsics.h"

namespace kinevox {

// Makes the board that lies on the floor the world: origin at its lower left corner, z up. `lying`: moments
// in which it does; the first one that was solved counts, and its neighbours in which the board lay as still.
// FailedPrecondition where none was.
absl::Status set_world_by_board(std::span<const int> lying, ExtrinsicsResult& result);

// Takes the world over from cameras that stood in one, where these seem to stand at about the same places:
// rigid, no scale. Tells in a finding how far they agree; false, and nothing changed, where they do not.
bool take_over_world(const std::vector<Camera>& like, ExtrinsicsResult& result);

// The cameras are the lenses'; they have no places.
Certificate lens_certificate(std::vector<IntrinsicsResult> lenses);

// `made_by` as in Certificate. With `world_is_set` the world is checked, too.
Certificate place_certificate(const std::string& made_by, ExtrinsicsResult result, bool world_is_set);

}  // namespace kinevox
