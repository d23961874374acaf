// Where the world lies: floor, origin and directions, for cameras whose places among themselves are known.
// World: metres, z up, the floor at z = 0. `old` is the frame that the cameras stand in so far.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board_detector.h"
#include "server/calibration/finding.h"
#include "server/calibration/silhouette_set.h"

namespace kinevox {

struct FloorResult {
    Rigid3 world_from_old;
    std::string made_by;                     // "board", "points", "person"
    std::optional<double> rms_px;            // of the board's or the points' reprojection
    std::optional<double> flat_rms_mm;       // how far points or contacts lie off the floor
    std::optional<double> tilt_std_deg;      // how surely the floor's tilt is known, worst direction
    std::optional<double> subject_height_m;  // where a person told it
    std::vector<Vec3> on_floor;              // m, world: board corners, points, or where feet touched it
    std::vector<Finding> findings;
};

// A board that lies on the floor, print up, as each camera saw it (any number of pictures together): its
// lower left corner becomes the origin, x along its columns, z out of the print. `thickness_m`: of the board.
// FailedPrecondition where no camera saw enough of it.
absl::StatusOr<FloorResult> floor_from_board(const std::vector<Camera>& cameras,
                                             const std::vector<Vec3>& board_points,
                                             const std::vector<std::vector<Corner>>& seen,
                                             double thickness_m = 0);

// A point of the floor, or of the room, as clicked in pictures.
struct FloorPoint {
    std::optional<Vec3> in_world;              // m, where it is known
    std::vector<std::pair<int, Vec2>> clicks;  // camera, px
};

// Three or more points, not in a line. Either all with world coordinates: the world is the one in which they
// have them, and where two cameras saw points, known distances check the scale. Or none: all lie on the floor
// and were clicked in two cameras or more; the first is the origin, x points to the second, z to the side of
// the cameras. InvalidArgument for points that cannot do; FailedPrecondition where no world fits.
absl::StatusOr<FloorResult> floor_from_points(const std::vector<Camera>& cameras,
                                              const std::vector<FloorPoint>& points);

struct FloorPersonOptions {
    double contact_std_m = 0.03;  // of a lowest point of the hull about the floor
    double lean_std_rad = 0.05;   // of the mean direction from the feet to the body's middle, about upright
    double highest_m = 0.025;     // above the floor: no contact but a step in the air
    double deepest_m = 0.05;      // below it: no foot but a shadow
    int max_moments = 60;
};

// From the silhouettes of a person who walks. The floor touches the lowest points of the person's hull,
// moment by moment, as far as these lie apart; across a walk along one line it rests on the body being
// upright on average. The origin is the centre of the path on the floor; x points from where the walk began
// to the point of the path farthest away, or, for somebody who stayed within 0.5 m, as the first camera
// looks. FailedPrecondition where nobody is seen; Cancelled by `progress`.
absl::StatusOr<FloorResult> floor_from_person(const std::vector<Camera>& cameras,
                                              const SilhouetteSet& silhouettes,
                                              const FloorPersonOptions& options = {},
                                              const SolveProgress& progress = {});

}  // namespace kinevox
