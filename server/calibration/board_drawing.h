// Prints boards into pictures.
#pragma once

#include <opencv2/aruco.hpp>

#include "server/calibration/board_detector.h"

namespace kinevox {

// See BoardDetector::draw(). `dictionary` may be null for a checkerboard.
Picture draw_board(const BoardSpec& board, const cv::Ptr<cv::aruco::Dictionary>& dictionary,
                   double pixels_per_m, Vec2& origin_px);

}  // namespace kinevox
