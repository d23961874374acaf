// Defines the world frame of cameras with known relative poses: floor, origin and axes. World: metres, z up,
// floor at z = 0. `old` is the cameras' current frame.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board/board_detector.h"
#include "server/calibration/finding.h"

namespace kinevox {

struct FloorResult {
    Rigid3 world_from_old;
    std::string method;                     // "board", "points", "person"
    std::optional<double> rms_px;           // reprojection error of the board or the points
    std::optional<double> flatness_rms_mm;  // of points or foot contacts against the floor
    std::optional<double> tilt_std_deg;     // standard deviation of the floor's tilt in the worst direction
    std::optional<double> stature_m;        // if measured from a person
    std::vector<Vec3> on_floor;             // m, world: board corners, points or foot contacts
    std::vector<Finding> findings;
};

// World frame from a board on the floor, print up. `seen`: each camera's corners over any number of images.
// Origin at the board's lower left corner, x along its columns, z out of the print. `thickness_m`: of the
// board. FailedPrecondition if no camera sees enough of it.
absl::StatusOr<FloorResult> floor_from_board(const std::vector<Camera>& cameras,
                                             const std::vector<Vec3>& board_points,
                                             const std::vector<std::vector<Corner>>& seen,
                                             double thickness_m = 0);

// A point clicked in one or more images.
struct FloorPoint {
    std::optional<Vec3> in_world;              // m, if known
    std::vector<std::pair<int, Vec2>> clicks;  // camera, px
};

// World frame from three or more points, not collinear. Either all have world coordinates: they define the
// world frame, and points seen by two cameras check the scale. Or none has: all lie on the floor and are
// clicked in two or more cameras; the first is the origin, x points to the second, z to the cameras' side.
// InvalidArgument for unusable points; FailedPrecondition if no world frame fits.
absl::StatusOr<FloorResult> floor_from_points(const std::vector<Camera>& cameras,
                                              const std::vector<FloorPoint>& points);

// Clicked points as text; in floor_points.cc.

// "0,0,0 cam1:412.5,300 cam3:99,120": optional world coordinates in m, then camera:u,v in px per click.
// InvalidArgument, one line.
absl::StatusOr<FloorPoint> parse_floor_point(std::string_view text, const std::vector<Camera>& cameras);

// One point per line; empty lines and comments after # are ignored.
absl::StatusOr<std::vector<FloorPoint>> read_floor_points(const std::filesystem::path& file,
                                                          const std::vector<Camera>& cameras);

}  // namespace kinevox
