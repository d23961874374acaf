// Refines extrinsics from a moving person, with a certificate: shared by `kinevox calibrate refine` and the
// daemon.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <vector>

#include "server/calibration/certificate/certificate.h"
#include "server/calibration/person/silhouette_refine.h"
#include "server/silhouettes/silhouette_set.h"

namespace kinevox {

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
