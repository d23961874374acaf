// Multi-view geometry: triangulation, similarity alignment, and relative camera poses joined into one frame.
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "common/camera.h"
#include "common/geometry.h"

namespace kinevox {

struct Observation {
    const Camera* camera = nullptr;
    Vec2 pixel;
};

// Unit direction of the ray through a pixel.
Vec3 direction_in_camera(Camera camera, Vec2 pixel);

// The point with the smallest reprojection error (Gauss-Newton from the rays' nearest point). Empty for fewer
// than two observations, parallel rays or a point behind a camera.
std::optional<Vec3> triangulate(const std::vector<Observation>& observations);

// Least-squares rigid transform, optionally with scale, from `from` to `to` (Umeyama 1991).
struct SimilarityTransform {
    double scale = 1;
    Rigid3 target_from_source;  // target = rotation * (scale * source) + translation
    Vec3 operator()(Vec3 from) const { return target_from_source * (scale * from); }
};
std::optional<SimilarityTransform> align_points(const std::vector<Vec3>& from, const std::vector<Vec3>& to,
                                                bool with_scale);

// Moves and scales the cameras together with their world frame.
void move_cameras(const SimilarityTransform& new_from_old, std::vector<Camera>& cameras);

// Angle between two rotations, radians.
double angle_between(const Mat3& a, const Mat3& b);

struct CameraPair {
    int a = 0, b = 0;  // camera indices
    Rigid3 a_from_b;
    int votes = 0;  // consistent frame sets
};

struct CameraTree {
    std::vector<Rigid3>
        camera_from_world;  // of the largest group; its best connected camera is the world frame
    std::vector<std::vector<int>> groups;  // connected cameras, largest group first
};

// By a maximum spanning tree over the camera pairs, so that each pose comes from the pairs with the most
// shared views.
CameraTree join_cameras(int cameras, std::vector<CameraPair> pairs);

}  // namespace kinevox
