#include "server/calibration/grey_picture.h"

#include <opencv2/imgproc.hpp>

namespace kinevox {

cv::Mat grey_of(const Picture& picture) {
    const cv::Mat view(picture.height, picture.width, CV_8UC(picture.channels),
                       const_cast<std::uint8_t*>(picture.data.get()));
    if (picture.channels != 3) return view;
    cv::Mat grey;
    cv::cvtColor(view, grey, cv::COLOR_BGR2GRAY);
    return grey;
}

}  // namespace kinevox
