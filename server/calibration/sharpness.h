// How blurred a board's edges are in a picture.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "server/calibration/board_detector.h"

namespace kinevox {

// The width over which the print's edges go from dark to light, px: contrast over the steepest slope, across
// the worse of the board's two directions (so that blur by movement counts), the median over the corners. 0
// where no corner has neighbours to tell the directions by. `points` by id, in the board frame.
double edge_width_px(const cv::Mat& grey, const std::vector<Corner>& corners,
                     const std::vector<Vec3>& points);

}  // namespace kinevox
