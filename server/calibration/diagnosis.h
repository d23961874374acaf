// What is wrong with a calibration when silhouettes disagree with it: each suspicion is tried out.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <vector>

#include "server/calibration/certificate.h"
#include "server/calibration/silhouette_refine.h"
#include "server/calibration/silhouette_set.h"

namespace kinevox {

struct DiagnosisOptions {
    double good_miss_part = 0.004;  // of the picture's longer side: rays that miss by less are right
    double bad_miss_part = 0.010;   // and by more are wrong
    SilhouetteRefineOptions refine;
};

// Findings about the agreement of cameras and silhouettes: cameras swapped, a picture upside down, one camera
// knocked, or else all of them off. One finding of kGo where they agree. Cancelled by `progress`.
absl::StatusOr<std::vector<Finding>> diagnose_silhouettes(const std::vector<Camera>& cameras,
                                                          const SilhouetteSet& silhouettes,
                                                          const DiagnosisOptions& options = {},
                                                          const SolveProgress& progress = {});

// The subject's lowest and highest point and how upright it is, from the hulls' vertical extent.
struct SubjectExtent {
    double lowest_m = 0, highest_m = 0;  // z, medians over the moments
    double width_m = 0;                  // the larger horizontal extent, median
};
std::optional<SubjectExtent> subject_extent(const std::vector<Camera>& cameras,
                                            const SilhouetteSet& silhouettes);

// World checks: cameras above the floor and upright, the subject standing on the floor, upright and of human
// height. `height_m`: what the subject is known to measure, if known.
std::vector<Finding> check_world(const std::vector<Camera>& cameras,
                                 const std::optional<SubjectExtent>& subject, std::optional<double> height_m);

}  // namespace kinevox
