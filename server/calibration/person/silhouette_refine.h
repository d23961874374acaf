// Refines the extrinsics of all cameras from a moving person's silhouettes.
//
// The ray through a contour point of one camera must intersect every other camera's silhouette at one common
// point of the ray; the pixel residual is minimised over all contours, cameras and frame sets. Silhouettes
// determine neither scale nor world frame: both are taken from the given poses.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/calibration/finding.h"
#include "server/silhouettes/silhouettes.h"

namespace kinevox {

struct SilhouetteRefineOptions {
    int max_frame_sets = 32;  // an even selection
    int contour_points = 56;  // per silhouette; 0: tangents only, from all frame sets
    int rounds = 30;          // maximum number of Gauss-Newton iterations
    double first_scale_fraction =
        0.03;  // of the image's longer side: scale of the robust kernel in the first round
    double last_scale_fraction = 0.004;  // and in the last
    // Of the image's longer side: the distance that a contour ray must lie within the other silhouettes.
    // Silhouettes that are slightly too wide would otherwise be consistent with many camera poses; with a
    // margin all limbs have small residuals on both sides, and the poses between are found.
    double margin_fraction = 0.0015;
    // Weight of planes tangent to two silhouettes (see SilhouetteTangents) against rays; 0: off. They
    // distinguish poses that contours alone hardly do.
    double tangent_weight = 0;
    double tangent_scale = 0.4;  // of the rays' scale: tangent planes are either exact or wrong
    double prior_angle_deg = 1, prior_shift_m = 0.07;  // prior standard deviations of the given poses
    double depth_step_m = 0.025;                       // of the search along a ray
    double radius_m = 1.6;                             // of that search, from the subject's centre
    std::vector<bool> fixed;                           // per camera: its pose stays fixed; empty: none
};

struct SilhouetteRefineResult {
    std::vector<Camera> cameras;
    double residual_before_px = 0, residual_after_px = 0;  // robust mean over all rays
    std::vector<double> rotated_deg, moved_m;              // per camera, against the given poses
    int rounds = 0;
};

// FailedPrecondition if too few frame sets have silhouettes in two cameras; Cancelled by `progress`.
absl::StatusOr<SilhouetteRefineResult> refine_from_silhouettes(const std::vector<Camera>& cameras,
                                                               const SilhouetteSet& silhouettes,
                                                               const SilhouetteRefineOptions& options = {},
                                                               const SolveProgress& progress = {});

// Robust mean silhouette residual of the given poses, px, over the cameras' own contours. Cheap enough to
// test hypotheses.
double silhouette_residual_px(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                              const SilhouetteRefineOptions& options = {});

// Split-half uncertainty of the extrinsics: the largest difference in any camera between the solutions of the
// first and the second half of the frame sets, after alignment. About twice the standard deviation of the
// solution from all frame sets. Silhouette errors that vary over the room count; constant ones do not show.
// Empty if a half has too few frame sets; Cancelled by `progress`.
struct ExtrinsicsUncertainty {
    double centre_mm = 0, rotation_deg = 0;
};
absl::StatusOr<std::optional<ExtrinsicsUncertainty>> split_half_uncertainty(
    const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes, SilhouetteRefineOptions options,
    const SolveProgress& progress = {});

// Over all cameras' images, px.
double max_side_px(const std::vector<Camera>& cameras);

// Aligns `cameras` with `like`, robustly, by a rigid transform and scale.
void align_to(const std::vector<Camera>& like, std::vector<Camera>& cameras);

}  // namespace kinevox
