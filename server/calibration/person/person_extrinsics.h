// Extrinsics of all cameras from a moving person only: no board, no wand, no initial guess.
//
// Silhouette landmarks (head, upper third, centre) relate pairs of cameras by their essential matrix; a
// spanning tree and a bundle adjustment join them; the contours then refine all poses. The scale comes from
// the subject's stature, the world frame from the positions of head and feet.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/calibration/finding.h"
#include "server/calibration/person/silhouette_refine.h"
#include "server/silhouettes/silhouettes.h"

namespace kinevox {

struct PersonExtrinsicsOptions {
    double height_m = 1.75;            // of the upright subject, with hair and shoes
    int first_frame_sets = 24;         // for the initial poses, an even selection
    int max_frame_sets = 150;          // for the final poses: silhouette errors vary between frame sets
    bool estimate_uncertainty = true;  // also solve both halves of the frame sets
    double landmark_error_fraction =
        0.012;  // of the image's longer side: landmarks with larger errors are outliers
};

struct PersonExtrinsicsResult {
    std::vector<Camera>
        cameras;  // solved ones; world: floor z = 0, z up, origin below the subject's mean position
    std::vector<std::string> excluded_cameras;         // that share too little with the others
    double residual_px = 0;                            // robust mean silhouette residual
    std::optional<ExtrinsicsUncertainty> uncertainty;  // split-half uncertainty
    int frame_sets = 0;                                // in which two or more cameras see the whole subject
    double walked_m = 0, walked_wide_m = 0;  // extent of the walk along its main direction and across it
    std::vector<Finding> findings;
};

// FailedPrecondition, with the remedy, if no two cameras share enough; Cancelled by `progress`. The poses in
// `intrinsics` are ignored.
absl::StatusOr<PersonExtrinsicsResult> extrinsics_from_person(const std::vector<Camera>& intrinsics,
                                                              const SilhouetteSet& silhouettes,
                                                              const PersonExtrinsicsOptions& options = {},
                                                              const SolveProgress& progress = {});

// Refines the result with silhouettes that were tracked with it: `silhouettes` of result.cameras.
absl::StatusOr<PersonExtrinsicsResult> improve_extrinsics_from_person(
    PersonExtrinsicsResult result, const SilhouetteSet& silhouettes,
    const PersonExtrinsicsOptions& options = {}, const SolveProgress& progress = {});

}  // namespace kinevox
