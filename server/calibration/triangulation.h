// Points from the rays of several cameras, and a camera from points.
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "common/camera.h"

namespace kinevox {

struct Sight {
    const Camera* camera = nullptr;
    Vec2 pixel;
};

// Of the ray through a pixel, length 1.
Vec3 direction_in_camera(Camera camera, Vec2 pixel);

// The point whose projections are nearest to the pixels (Gauss-Newton from the rays' nearest point). Nothing
// for fewer than two sights, parallel rays or a point behind a camera.
std::optional<Vec3> triangulate(const std::vector<Sight>& sights);

// The rigid transform (and scale, where asked for) that takes `from` nearest to `to`, least squares (Umeyama
// 1991).
struct Alignment {
    double scale = 1;
    Rigid3 to_from_from;  // to = rotation * (scale * from) + translation
    Vec3 operator()(Vec3 from) const { return to_from_from * (scale * from); }
};
std::optional<Alignment> align_points(const std::vector<Vec3>& from, const std::vector<Vec3>& to,
                                      bool with_scale);

// Cameras moved and scaled with the world they stand in.
void move_cameras(const Alignment& new_from_old, std::vector<Camera>& cameras);

// Angle between two rotations, radians.
double angle_between(const Mat3& a, const Mat3& b);

}  // namespace kinevox
