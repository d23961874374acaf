// World frame, scale and floor from a walking person.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board/floor.h"
#include "server/calibration/multi_view.h"
#include "server/silhouettes/silhouettes.h"

namespace kinevox {

struct PersonWorld {
    SimilarityTransform
        world_from_solved;     // world: floor z = 0, z up, origin below the subject's mean position
    double height_solved = 0;  // of the upright subject, in the cameras' units
    double way_long_m = 0,
           way_wide_m = 0;     // extent of the subject's positions on the floor, along and across
    double uneven_height = 1;  // upper over median height of the hulls
    int frame_sets = 0;
};

// World frame and scale. `up_in_solved`: approximate. Empty for fewer than five hulls. The subject should
// walk upright with the arms down for some of the time.
std::optional<PersonWorld> person_world(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                                        Vec3 up_in_solved, double height_m);

struct FloorPersonOptions {
    double contact_std_m = 0.03;  // of the hull's lowest point about the floor
    double lean_std_rad = 0.05;   // of the mean direction from the feet to the body's centre, about upright
    double highest_m = 0.025;     // above the floor: a step in the air, no contact
    double deepest_m = 0.05;      // below the floor: a shadow, no foot
    int max_frame_sets = 60;
};

// World frame from a walking person's silhouettes. The floor is fitted to the lowest hull points of all frame
// sets; for a straight walk, tilt across the path relies on an upright body. The origin is the centre of the
// path on the floor; x points from the start of the walk to its farthest point, or along the first camera's
// view if the person stays within 0.5 m. FailedPrecondition if no person is found; Cancelled by `progress`.
absl::StatusOr<FloorResult> floor_from_person(const std::vector<Camera>& cameras,
                                              const SilhouetteSet& silhouettes,
                                              const FloorPersonOptions& options = {},
                                              const SolveProgress& progress = {});

}  // namespace kinevox
