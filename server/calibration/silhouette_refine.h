// All cameras' places from the silhouettes of a person who moves, starting from places that are about right.
//
// The ray through a point on one camera's outline must meet every other camera's silhouette at one and the
// same place of the ray; by how many pixels it misses them is what is minimised, over all outlines, cameras
// and moments. Scale and world cannot come from silhouettes: they are taken from the places given, and
// cameras that hardly move keep them.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/calibration/finding.h"
#include "server/calibration/silhouette_set.h"

namespace kinevox {

struct SilhouetteRefineOptions {
    int max_moments = 32;     // evenly from those given
    int outline_points = 56;  // per silhouette; 0: tangents alone, from all moments
    int rounds = 30;          // of Gauss-Newton, at most
    double first_scale_part =
        0.03;  // of the picture's longer side: misses beyond it count less and less, at first
    double last_scale_part = 0.004;  // and at the end
    // Of the picture's longer side: by so much within the other silhouettes an outline's ray must lie.
    // Silhouettes that come out a little wide would otherwise meet at many places of the cameras; with a
    // margin the ends of all limbs miss a little on each side and the places between are found.
    double margin_part = 0.0015;
    // Planes that touch two silhouettes at once (see silhouette_tangents.h) count so much against rays; 0:
    // not at all. They tell two places apart that outlines alone hardly do.
    double tangent_weight = 0;
    double tangent_scale = 0.4;  // of the rays' scale: touching planes are exact, or they are wrong
    double prior_angle_deg = 1, prior_shift_m = 0.07;  // standard deviations of the places given
    double depth_step_m = 0.025;                       // of the search along a ray
    double reach_m = 1.6;                              // of that search, from the subject's middle
    std::vector<bool> fixed;                           // per camera: stays where it is; empty: none does
};

struct SilhouetteRefineResult {
    std::vector<Camera> cameras;
    double miss_before_px = 0, miss_after_px = 0;  // robust mean over all rays
    std::vector<double> turned_deg, moved_m;       // per camera, against the places given
    int rounds = 0;
};

// FailedPrecondition where too few silhouettes are seen by two cameras at a time; Cancelled by `progress`.
absl::StatusOr<SilhouetteRefineResult> refine_from_silhouettes(const std::vector<Camera>& cameras,
                                                               const SilhouetteSet& silhouettes,
                                                               const SilhouetteRefineOptions& options = {},
                                                               const SolveProgress& progress = {});

// How well places fit silhouettes: the robust mean of what the refinement minimises, px, over the cameras'
// own outlines. Cheap: for trying what could be wrong.
double silhouette_miss_px(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                          const SilhouetteRefineOptions& options = {});

// How far refined places can be trusted: by how much those from the first half of the moments and those from
// the second differ in the worst camera, once world and scale are taken out. About twice the standard
// deviation of places from all moments. Whatever is wrong with a silhouette at one place of the room and not
// at another counts; what is wrong all the time is not seen. Nothing where half of the moments are too few;
// Cancelled by `progress`.
struct PlacesUncertainty {
    double centre_mm = 0, turn_deg = 0;
};
absl::StatusOr<std::optional<PlacesUncertainty>> places_uncertainty(const std::vector<Camera>& cameras,
                                                                    const SilhouetteSet& silhouettes,
                                                                    SilhouetteRefineOptions options,
                                                                    const SolveProgress& progress = {});

// Of the cameras' pictures, px.
double max_side_px(const std::vector<Camera>& cameras);

// Moves `cameras` so that they lie as `like` does: rigid and scale, by the most of them that agree.
void align_to(const std::vector<Camera>& like, std::vector<Camera>& cameras);

}  // namespace kinevox
