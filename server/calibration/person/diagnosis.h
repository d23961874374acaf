// Finds the cause if silhouettes are inconsistent with a calibration, by testing each hypothesis.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <vector>

#include "server/calibration/certificate/certificate.h"
#include "server/calibration/person/silhouette_refine.h"
#include "server/silhouettes/silhouettes.h"

namespace kinevox {

struct DiagnosisOptions {
    double good_residual_fraction = 0.004;  // of the image's longer side: smaller residuals are good
    double bad_residual_fraction = 0.010;   // and larger ones are bad
    SilhouetteRefineOptions refine;
};

// Consistency of cameras and silhouettes: cameras swapped, an image upside down, one camera moved, or all of
// them off. One finding of kGo if they are consistent. Cancelled by `progress`.
absl::StatusOr<std::vector<Finding>> diagnose_silhouettes(const std::vector<Camera>& cameras,
                                                          const SilhouetteSet& silhouettes,
                                                          const DiagnosisOptions& options = {},
                                                          const SolveProgress& progress = {});

// The subject's vertical and horizontal extent, of the silhouettes' hull: with shoes, hair and raised arms.
struct SubjectExtent {
    double lowest_m = 0, highest_m = 0;  // z, medians over the frame sets
    double width_m = 0;                  // horizontal distance between top and bottom, median
};
std::optional<SubjectExtent> subject_extent(const std::vector<Camera>& cameras,
                                            const SilhouetteSet& silhouettes);

// World checks: cameras above the floor and upright; the subject on the floor, upright and of human height.
// `stature_m`: the subject's, if known.
std::vector<Finding> check_world(const std::vector<Camera>& cameras,
                                 const std::optional<SubjectExtent>& subject, std::optional<double> height_m);

}  // namespace kinevox
