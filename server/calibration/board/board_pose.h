// Pose of a board relative to a camera with known intrinsics.
#pragma once

#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board/board_detector.h"

namespace kinevox {

struct BoardPose {
    Rigid3 camera_from_board;
    double rms_px = 0;
    // Ratio of the error of the second planar solution to this one's; near 1 the pose is ambiguous.
    double ambiguity_ratio = 1;
    // Angle between the print's normal and the direction to the camera, radians; above pi / 2 the print is
    // seen from behind.
    double tilt_rad = 0;
};

// Empty for fewer than four corners or without a valid pose. `points` by id, in the board frame.
std::optional<BoardPose> board_pose(const Camera& camera, const std::vector<Corner>& corners,
                                    const std::vector<Vec3>& points);

}  // namespace kinevox
