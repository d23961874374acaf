// Pixels as OpenCV's geometry of two views takes them: without lens and focal length.
#pragma once

#include <opencv2/core/types.hpp>

#include "server/calibration/triangulation.h"

namespace kinevox {

// Where the pixel's ray meets the plane at z = 1 of the camera frame.
inline cv::Point2d on_unit_plane(const Camera& camera, Vec2 pixel) {
    const Vec3 d = direction_in_camera(camera, pixel);
    return {d.x / d.z, d.y / d.z};
}

}  // namespace kinevox
