// All cameras' places from nothing but a person who moves: no board, no wand, no first guess.
//
// Landmarks of the silhouettes (head, upper third, centre) tie pairs of cameras by their essential matrix; a
// spanning tree and a bundle adjustment join them; the outlines themselves then say exactly where each camera
// stands. The scale comes from the subject's height, the world from where head and feet are.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/calibration/finding.h"
#include "server/calibration/silhouette_refine.h"
#include "server/calibration/silhouette_set.h"

namespace kinevox {

struct PersonExtrinsicsOptions {
    double height_m = 1.75;  // of the subject upright, with hair and shoes
    int first_moments = 24;  // for the first places, evenly from those given
    int max_moments = 150;   // for the last: what is wrong with a silhouette differs from moment to moment
    bool tell_uncertainty = true;  // solves the halves of the moments, too
    double landmark_px_part =
        0.012;  // of the picture's longer side: landmarks that miss by more do not count
};

struct PersonExtrinsicsResult {
    std::vector<Camera>
        cameras;  // solved ones; world: floor z = 0, z up, origin under where the subject moved
    std::vector<std::string> left_out;             // cameras that share too little with these
    double miss_px = 0;                            // robust mean of the outlines' misses
    std::optional<PlacesUncertainty> uncertainty;  // of the places: between halves of the moments
    int moments = 0;                               // in which two cameras or more saw the whole subject
    double walked_m = 0, walked_wide_m = 0;  // extent of the subject's places along their way and across it
    std::vector<Finding> findings;
};

// FailedPrecondition, with the remedy, where no two cameras share enough; Cancelled by `progress`. The places
// of `lenses` are not used.
absl::StatusOr<PersonExtrinsicsResult> extrinsics_from_person(const std::vector<Camera>& lenses,
                                                              const SilhouetteSet& silhouettes,
                                                              const PersonExtrinsicsOptions& options = {},
                                                              const SolveProgress& progress = {});

// The same places once more, from silhouettes that were followed with them: `silhouettes` of result.cameras.
absl::StatusOr<PersonExtrinsicsResult> improve_extrinsics_from_person(
    PersonExtrinsicsResult result, const SilhouetteSet& silhouettes,
    const PersonExtrinsicsOptions& options = {}, const SolveProgress& progress = {});

}  // namespace kinevox
