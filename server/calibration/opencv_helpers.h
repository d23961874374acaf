// Input of OpenCV's detectors and two-view geometry. OpenCV types: for .cc files only.
#pragma once

#include <opencv2/core.hpp>

#include "server/calibration/triangulation.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

// Shares the image's memory if it is grey already: read only.
cv::Mat grey_of(const Image& image);

// Undistorted point on the plane z = 1 of the camera frame.
inline cv::Point2d normalised_image_point(const Camera& camera, Vec2 pixel) {
    const Vec3 d = direction_in_camera(camera, pixel);
    return {d.x / d.z, d.y / d.z};
}

}  // namespace kinevox
