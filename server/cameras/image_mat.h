// Images and masks as cv::Mat, without copying. Read only, although cv::Mat has no const form: only for .cc
// files that link OpenCV.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "server/cameras/frame_source.h"

namespace kinevox {

inline cv::Mat as_mat(const Image& image) {
    return cv::Mat(image.height, image.width, CV_8UC(image.channels),
                   const_cast<std::uint8_t*>(image.data.get()));
}

// `mask`: width * height bytes.
inline cv::Mat as_mat(const std::uint8_t* mask, int width, int height) {
    return cv::Mat(height, width, CV_8UC1, const_cast<std::uint8_t*>(mask));
}

}  // namespace kinevox
