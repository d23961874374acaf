// Measures the blur of a board's edges.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "server/calibration/board/board_detector.h"

namespace kinevox {

// Width of the print's edges from dark to light, px: contrast over the steepest slope, across the worse of
// the board's two directions (motion blur), median over the corners. 0 if no corner has neighbours in both
// directions. `points` by id, in the board frame.
double edge_width_px(const cv::Mat& grey, const std::vector<Corner>& corners,
                     const std::vector<Vec3>& points);

}  // namespace kinevox
