#include "server/calibration/opencv_helpers.h"

#include <opencv2/imgproc.hpp>

#include "server/cameras/image_mat.h"

namespace kinevox {

cv::Mat grey_of(const Image& image) {
    const cv::Mat view = as_mat(image);
    if (image.channels != 3) return view;
    cv::Mat grey;
    cv::cvtColor(view, grey, cv::COLOR_BGR2GRAY);
    return grey;
}

}  // namespace kinevox
