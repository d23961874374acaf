// A camera prepared for projecting many points, and bounds of a projected cube.
#pragma once

#include <cmath>

#include "kernels/shared/device.h"
#include "kernels/types.h"

namespace kinevox::kernels {

// Plain data, copied to the device as it is. World to pixel, see CameraModel.
struct Projector {
    int width = 0, height = 0;  // px
    float r[9];                 // camera_from_world, row major
    float t[3];                 // m
    float fx, fy, cx, cy;       // px
    float k1, k2, p1, p2, k3;
    bool distorted = false;
    // Beyond this squared radius of normalised coordinates a point counts as unseen: OpenCV's polynomial
    // turns back there and would fold far points into the image.
    float max_radius2 = 0;
    // Largest stretch of the distortion inside that radius, >= 1; bounds what a small step can move in the
    // image.
    float stretch = 1;
};

inline constexpr float kNearest_m = 0.05f;  // nothing nearer to a camera is seen

// Throws std::invalid_argument for a camera without a size, with a focal length that is not positive or with
// a value that is not finite; `what` names it in the message.
Projector make_projector(const CameraModel& camera, const char* what);

struct CameraPoint {
    float x, y, z;  // m, camera frame
};

KINEVOX_HD KINEVOX_INLINE CameraPoint to_camera(const Projector& c, float x, float y, float z) {
    return {c.r[0] * x + c.r[1] * y + c.r[2] * z + c.t[0], c.r[3] * x + c.r[4] * y + c.r[5] * z + c.t[1],
            c.r[6] * x + c.r[7] * y + c.r[8] * z + c.t[2]};
}

// Distorts normalised coordinates (x, y) (OpenCV: k1 k2 p1 p2 k3).
KINEVOX_HD KINEVOX_INLINE void distort(const Projector& c, float& x, float& y) {
    const float r2 = x * x + y * y;
    const float radial = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
    const float xd = x * radial + 2 * c.p1 * x * y + c.p2 * (r2 + 2 * x * x);
    const float yd = y * radial + c.p1 * (r2 + 2 * y * y) + 2 * c.p2 * x * y;
    x = xd;
    y = yd;
}

// Pixel of a camera point; false where the camera cannot see that way. (u, v) may lie outside the image.
KINEVOX_HD KINEVOX_INLINE bool to_pixel(const Projector& c, CameraPoint p, float& u, float& v) {
    const float w = 1 / p.z;
    float x = p.x * w, y = p.y * w;
    const bool seen = p.z > kNearest_m && x * x + y * y < c.max_radius2;
    if (c.distorted) distort(c, x, y);
    u = c.fx * x + c.cx;
    v = c.fy * y + c.cy;
    return seen;
}

// The nearest pixel's column or row; the first pixel's centre is 0. Rounds half up, as floor does, for every
// value that can be a pixel of ours.
KINEVOX_HD KINEVOX_INLINE int to_index(float u) {
    u = u < -30000.f ? -30000.f : (u > 30000.f ? 30000.f : u);
    return static_cast<int>(u + 32768.5f) - 32768;
}

// Where all points of an axis-aligned cube (centre, half edge in m) fall: within +-radius_px of (u, v) in
// both directions. False: the cube comes too near to the camera or to the limit of its distortion model for a
// bound.
KINEVOX_HD KINEVOX_INLINE bool cube_bound(const Projector& c, float x, float y, float z, float half_edge,
                                          float& u, float& v, float& radius_px) {
    const CameraPoint p = to_camera(c, x, y, z);
    const float extent_z = half_edge * (fabsf(c.r[6]) + fabsf(c.r[7]) + fabsf(c.r[8]));
    const float nearest = p.z - extent_z;
    if (!(nearest > kNearest_m)) return false;
    const float a = p.x / p.z, b = p.y / p.z;
    // (X + dX) / (Z + dZ) - X / Z = (dX - a dZ) / (Z + dZ), and dX - a dZ is linear in the cube's offset.
    const float extent_x =
        half_edge * (fabsf(c.r[0] - a * c.r[6]) + fabsf(c.r[1] - a * c.r[7]) + fabsf(c.r[2] - a * c.r[8]));
    const float extent_y =
        half_edge * (fabsf(c.r[3] - b * c.r[6]) + fabsf(c.r[4] - b * c.r[7]) + fabsf(c.r[5] - b * c.r[8]));
    const float move_x = extent_x / nearest, move_y = extent_y / nearest;
    const float far_x = fabsf(a) + move_x, far_y = fabsf(b) + move_y;
    if (!(far_x * far_x + far_y * far_y < c.max_radius2)) return false;
    if (!to_pixel(c, p, u, v)) return false;
    if (c.distorted) {
        radius_px = c.stretch * fmaxf(c.fx, c.fy) * sqrtf(move_x * move_x + move_y * move_y);
    } else {
        radius_px = fmaxf(c.fx * move_x, c.fy * move_y);
    }
    return true;
}

}  // namespace kinevox::kernels
