// Projection as a template for Ceres' automatic differentiation. For .cc files only.
#pragma once

#include <ceres/rotation.h>

#include "common/camera.h"

namespace kinevox {

inline constexpr int kIntrinsicCount = 9;  // fx fy cx cy k1 k2 p1 p2 k3
inline constexpr int kPoseCount = 6;       // Rodrigues vector, translation

// Camera::project for a point in the camera frame; false behind the camera.
template <class T>
bool project_in_camera(const T* intrinsics, const T point[3], T pixel[2]) {
    if (!(point[2] > T(1e-6))) return false;
    const T x = point[0] / point[2], y = point[1] / point[2];
    const T r2 = x * x + y * y;
    const T radial = T(1) + r2 * (intrinsics[4] + r2 * (intrinsics[5] + r2 * intrinsics[8]));
    const T &p1 = intrinsics[6], &p2 = intrinsics[7];
    pixel[0] = intrinsics[0] * (x * radial + T(2) * p1 * x * y + p2 * (r2 + T(2) * x * x)) + intrinsics[2];
    pixel[1] = intrinsics[1] * (y * radial + p1 * (r2 + T(2) * y * y) + T(2) * p2 * x * y) + intrinsics[3];
    return true;
}

template <class T>
void transform(const T* pose, const T point[3], T out[3]) {
    ceres::AngleAxisRotatePoint(pose, point, out);
    for (int i = 0; i < 3; ++i) out[i] += pose[3 + i];
}

inline void to_parameters(const Rigid3& transform, double pose[kPoseCount]) {
    const Vec3 r = rodrigues_from_rotation(transform.rotation), t = transform.translation;
    const double values[kPoseCount] = {r.x, r.y, r.z, t.x, t.y, t.z};
    std::copy(values, values + kPoseCount, pose);
}
inline Rigid3 to_rigid(const double pose[kPoseCount]) {
    return {rotation_from_rodrigues({pose[0], pose[1], pose[2]}), {pose[3], pose[4], pose[5]}};
}
inline void to_parameters(const Camera& c, double intrinsics[kIntrinsicCount]) {
    const double values[kIntrinsicCount] = {c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2, c.k3};
    std::copy(values, values + kIntrinsicCount, intrinsics);
}
inline void set_intrinsics(const double in[kIntrinsicCount], Camera& c) {
    c.fx = in[0], c.fy = in[1], c.cx = in[2], c.cy = in[3];
    c.k1 = in[4], c.k2 = in[5], c.p1 = in[6], c.p2 = in[7], c.k3 = in[8];
}

}  // namespace kinevox
