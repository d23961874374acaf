// Renders boards.
#pragma once

#include <opencv2/aruco.hpp>

#include "server/calibration/board/board_detector.h"

namespace kinevox {

// See BoardDetector::draw(). `dictionary` may be null for a checkerboard.
Image draw_board(const BoardSpec& board, const cv::Ptr<cv::aruco::Dictionary>& dictionary,
                 double pixels_per_m, Vec2& origin_px);

}  // namespace kinevox
