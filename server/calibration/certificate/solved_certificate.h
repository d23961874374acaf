// Certificates of solved calibrations, their world frame, and the refinement by a person.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "server/calibration/board/extrinsics.h"
#include "server/calibration/board/intrinsics.h"
#include "server/calibration/certificate/certificate.h"
#include "server/calibration/person/silhouette_refine.h"
#include "server/silhouettes/silhouettes.h"

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

// Refines extrinsics from a moving person, with a certificate: shared by `kinevox calibrate refine` and the
// daemon.

// Adds the checks that a person allows to a certificate with a world frame: stature, overlays, floor, scale
// and uprightness.
void check_with_person(const SilhouetteSet& silhouettes, std::optional<double> height_m,
                       Certificate& certificate);

struct PersonRefinement {
    Certificate certificate;                       // its cameras are the refined ones, or those given
    std::optional<SilhouetteRefineResult> better;  // empty: no improvement
};

// Half of the frame sets are held out to measure the result; at most `frame_sets` of the other half are
// fitted. `stature_m`: the subject's, as measured; empty: unknown. FailedPrecondition if too few frame sets
// have silhouettes in two cameras; Cancelled by `progress`.
absl::StatusOr<PersonRefinement> refine_from_person(const std::vector<Camera>& cameras,
                                                    const SilhouetteSet& silhouettes, int frame_sets,
                                                    std::optional<double> height_m,
                                                    const SolveProgress& progress);

}  // namespace kinevox
