// A calibrated camera: pinhole with OpenCV's distortion, and its place in the world.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "common/geometry.h"

namespace kinevox {

// Points on a viewing ray: origin_in_world + s * direction_in_world, s > 0. The direction has length 1.
struct Ray {
    Vec3 origin_in_world;  // m, the camera's centre
    Vec3 direction_in_world;
};

struct Camera {
    std::string name;                       // the section in the calibration file, unique
    int width = 0, height = 0;              // px
    double fx = 0, fy = 0, cx = 0, cy = 0;  // px; the first pixel's centre is (0, 0)
    double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;
    Rigid3 camera_from_world;  // OpenCV axes: x right, y down, z forward

    Vec3 centre_in_world() const { return camera_from_world.inverse().translation; }

    // Pixel of a world point; nothing if it lies behind the camera. May lie outside the image. As OpenCV's
    // projectPoints; far outside the field of view a strong distortion may fold points back into the image.
    std::optional<Vec2> project(Vec3 point_in_world) const;

    // The ray through a pixel, distortion undone by iteration.
    Ray ray_through(Vec2 pixel) const;

    bool operator==(const Camera&) const = default;
};

// The one of that name, null where there is none.
const Camera* camera_named(std::span<const Camera> cameras, std::string_view name);

// Camera names become folders and file names: empty if `name` may be one, else what is wrong with it.
std::string camera_name_problem(std::string_view name);

}  // namespace kinevox
