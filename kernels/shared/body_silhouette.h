// A tapered capsule in a camera's frame, and whether a ray from the camera's centre meets it.
#pragma once

#include <cmath>

#include "kernels/body_silhouette.h"
#include "kernels/shared/camera.h"
#include "kernels/shared/device.h"

namespace kinevox::kernels {

struct CameraCapsule {
    CameraPoint a, b;  // m, camera frame
    float radius_a, radius_b;
};

// Cut to the part that lies in front of the camera; false where nothing does.
KINEVOX_HD KINEVOX_INLINE bool capsule_in_camera(const Projector& camera, const TaperedCapsule& c,
                                                 CameraCapsule& out) {
    CameraPoint a = to_camera(camera, c.a[0], c.a[1], c.a[2]), b = to_camera(camera, c.b[0], c.b[1], c.b[2]);
    float ra = c.radius_a, rb = c.radius_b;
    const float near_a = a.z - ra - kNearest_m, near_b = b.z - rb - kNearest_m;  // linear along the axis
    if (!(near_a > 0) && !(near_b > 0)) return false;
    if (!(near_a > 0) || !(near_b > 0)) {
        const float t = near_a / (near_a - near_b);
        const CameraPoint cut{a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), a.z + t * (b.z - a.z)};
        const float radius = ra + t * (rb - ra);
        if (near_a > 0) {
            b = cut, rb = radius;
        } else {
            a = cut, ra = radius;
        }
    }
    out = {a, b, ra, rb};
    return true;
}

// The ray (x, y, 1) s. The ball at t in [0, 1] is met where its centre's distance to the ray is at most its
// radius; the difference of their squares is a quadratic function of t.
KINEVOX_HD KINEVOX_INLINE bool ray_meets_capsule(const CameraCapsule& c, float x, float y) {
    const float scale = 1 / (x * x + y * y + 1);
    const float ex = c.b.x - c.a.x, ey = c.b.y - c.a.y, ez = c.b.z - c.a.z, er = c.radius_b - c.radius_a;
    const float ad = c.a.x * x + c.a.y * y + c.a.z, ed = ex * x + ey * y + ez;
    const float aa =
        c.a.x * c.a.x + c.a.y * c.a.y + c.a.z * c.a.z - ad * ad * scale - c.radius_a * c.radius_a;
    const float ae = c.a.x * ex + c.a.y * ey + c.a.z * ez - ad * ed * scale - c.radius_a * er;
    const float ee = ex * ex + ey * ey + ez * ez - ed * ed * scale - er * er;
    if (aa <= 0 || ee + 2 * ae + aa <= 0) return true;  // one of the ends
    return ee > 0 && ae < 0 && -ae < ee && aa * ee <= ae * ae;
}

// Normalised coordinates of a pixel, distortion undone by iteration as OpenCV does it.
KINEVOX_HD KINEVOX_INLINE void undistorted(const Projector& c, float u, float v, float& x, float& y) {
    const float xd = (u - c.cx) / c.fx, yd = (v - c.cy) / c.fy;
    x = xd, y = yd;
    if (!c.distorted) return;
    for (int n = 0; n < 12; ++n) {
        const float r2 = x * x + y * y;
        const float radial = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
        const float dx = 2 * c.p1 * x * y + c.p2 * (r2 + 2 * x * x),
                    dy = c.p1 * (r2 + 2 * y * y) + 2 * c.p2 * x * y;
        x = (xd - dx) / radial;
        y = (yd - dy) / radial;
    }
}

}  // namespace kinevox::kernels
