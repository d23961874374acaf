// Input of OpenCV's detectors and two-view geometry. OpenCV types: for .cc files only.
#pragma once

#include <opencv2/imgproc.hpp>

#include "server/calibration/multi_view.h"
#include "server/cameras/image_mat.h"

namespace kinevox {

// Shares the image's memory if it is grey already: read only.
inline cv::Mat grey_of(const Image& image) {
    const cv::Mat view = as_mat(image);
    if (image.channels != 3) return view;
    cv::Mat grey;
    cv::cvtColor(view, grey, cv::COLOR_BGR2GRAY);
    return grey;
}

// Undistorted point on the plane z = 1 of the camera frame.
inline cv::Point2d normalised_image_point(const Camera& camera, Vec2 pixel) {
    const Vec3 d = direction_in_camera(camera, pixel);
    return {d.x / d.z, d.y / d.z};
}

}  // namespace kinevox
