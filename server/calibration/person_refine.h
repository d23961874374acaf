// Better places from a person who moves, with a certificate: what `kinevox calibrate refine` and the daemon share.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <vector>

#include "server/calibration/certificate.h"
#include "server/calibration/silhouette_refine.h"
#include "server/calibration/silhouette_set.h"
#include "server/pipeline/frame_result.h"

namespace kinevox {

// What the tracked subject covers in each camera's picture; where a camera is not tracked, the largest thing that moves
// there and what lies beside it. Empty pictures where neither can be told.
std::vector<SilhouettePicture> silhouettes_of(const FrameResult& result, const std::vector<Camera>& cameras);

struct PersonRefinement {
    Certificate certificate;                       // its cameras are the better ones, or those given
    std::optional<SilhouetteRefineResult> better;  // empty: no other places fit the silhouettes better
};

// `height_m`: the subject's, as measured; empty: not known. FailedPrecondition where too few silhouettes are seen by two
// cameras at a time; Cancelled by `progress`.
absl::StatusOr<PersonRefinement> refine_from_person(const std::vector<Camera>& cameras,
                                                    const SilhouetteSet& silhouettes, int moments,
                                                    std::optional<double> height_m, const SolveProgress& progress);

}  // namespace kinevox
