// Better places from a person who moves, with a certificate: what `kinevox calibrate refine` and the daemon
// share.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <vector>

#include "server/calibration/certificate.h"
#include "server/calibration/silhouette_refine.h"
#include "server/calibration/silhouette_set.h"

namespace kinevox {

// Adds to a certificate, whose cameras stand in a world, what a person tells of it: height, pictures of the
// agreement, and whether floor, scale and uprightness can be.
void judge_by_person(const SilhouetteSet& silhouettes, std::optional<double> height_m,
                     Certificate& certificate);

struct PersonRefinement {
    Certificate certificate;                       // its cameras are the better ones, or those given
    std::optional<SilhouetteRefineResult> better;  // empty: no other places fit the silhouettes better
};

// Half of the moments measure the result, at most `moments` of the other half are fitted to. `height_m`: the
// subject's, as measured; empty: not known. FailedPrecondition where too few silhouettes are seen by two
// cameras at a time; Cancelled by `progress`.
absl::StatusOr<PersonRefinement> refine_from_person(const std::vector<Camera>& cameras,
                                                    const SilhouetteSet& silhouettes, int moments,
                                                    std::optional<double> height_m,
                                                    const SolveProgress& progress);

}  // namespace kinevox
