// Pictures as the detectors look at them. OpenCV's, so for .cc files only.
#pragma once

#include <opencv2/core.hpp>

#include "server/cameras/frame_source.h"

namespace kinevox {

// Shares the picture's memory where it is grey already: not to be written to.
cv::Mat grey_of(const Picture& picture);

}  // namespace kinevox
