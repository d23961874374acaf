// Where a board lies before a camera whose lens is known.
#pragma once

#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board_detector.h"

namespace kinevox {

struct BoardPose {
    Rigid3 camera_from_board;
    double rms_px = 0;
    // Error of the mirrored solution that every plane has, over this one's: near 1 the two cannot be told
    // apart.
    double ambiguity_ratio = 1;
    // Between the print's normal and the direction from the board to the camera, radians; beyond pi / 2 it
    // would be seen from behind.
    double tilt_rad = 0;
};

// Nothing for fewer than four corners or where no pose fits. `points` by id, in the board frame.
std::optional<BoardPose> board_pose(const Camera& camera, const std::vector<Corner>& corners,
                                    const std::vector<Vec3>& points);

}  // namespace kinevox
