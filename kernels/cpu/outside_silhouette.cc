#include "kernels/outside_silhouette.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "kernels/cpu/dispatch.h"

// Plain loops over a block of balls, which the compiler vectorises for each family that Highway chooses from.
#ifdef KINEVOX_HAVE_HIGHWAY
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/cpu/outside_silhouette.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
HWY_BEFORE_NAMESPACE();
#endif

namespace kinevox::kernels::HWY_NAMESPACE {

constexpr int kBlock = 16;  // balls

void measure_outside(const PinholeView& camera, const DistanceMapView& map, const BallList& balls,
                     double min_depth_m, const OutsideList& out) {
    const PinholeView c = camera;
    const double* const r = c.rotation;
    const double* const t = c.translation;
    const double cell = map.cell, half = 0.5 * (map.cell - 1), focal = c.fx + c.fy;
    const double last_column = map.columns - 1, last_row = map.rows - 1;
    const std::int32_t across = map.columns > 1, down = map.rows > 1 ? map.columns : 0;
    const std::int32_t max_column = std::max(0, map.columns - 2), max_row = std::max(0, map.rows - 2);
    const float* const distances = map.distance;
    const double *const xs = balls.centre[0], *const ys = balls.centre[1], *const zs = balls.centre[2];
    double *const to_x = out.in_camera[0], *const to_y = out.in_camera[1], *const to_z = out.in_camera[2];
    double *const slope_x = out.slope[0], *const slope_y = out.slope[1], *const to_outside = out.outside_m;
    double *const pixel_x = out.pixel[0], *const pixel_y = out.pixel[1];
    const double* const radius = balls.radius;
    const double right = c.width - 0.5, bottom = c.height - 0.5, x0 = map.x0, y0 = map.y0;
    const std::int32_t stride = map.columns;
    double ox[kBlock], oy[kBlock], beyond[kBlock], inside[kBlock], m_per_px[kBlock], in_image[kBlock];
    for (int first = 0; first < balls.count; first += kBlock) {
        const int size = std::min(kBlock, balls.count - first);
#pragma GCC ivdep
        for (int k = 0; k < size; ++k) {
            const int n = first + k;
            const double wx = xs[n], wy = ys[n], wz = zs[n];
            const double x = r[0] * wx + r[1] * wy + r[2] * wz + t[0],
                         y = r[3] * wx + r[4] * wy + r[5] * wz + t[1],
                         z = r[6] * wx + r[7] * wy + r[8] * wz + t[2];
            const bool in_front = z > min_depth_m;
            const double depth = in_front ? z : 1;
            const double u = x / depth, v = y / depth, r2 = u * u + v * v;
            const double radial = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
            const double px = c.fx * (u * radial + 2 * c.p1 * u * v + c.p2 * (r2 + 2 * u * u)) + c.cx;
            const double py = c.fy * (v * radial + c.p1 * (r2 + 2 * v * v) + 2 * c.p2 * u * v) + c.cy;
            const bool seen = in_front & (px > -0.5) & (py > -0.5) & (px < right) & (py < bottom);
            const double fx = (px - x0 - half) / cell, fy = (py - y0 - half) / cell;
            const double gx = seen ? fx : 0, gy = seen ? fy : 0;
            const double cx = std::min(std::max(gx, 0.0), last_column),
                         cy = std::min(std::max(gy, 0.0), last_row);
            const std::int32_t i = std::min(static_cast<std::int32_t>(cx), max_column),
                               j = std::min(static_cast<std::int32_t>(cy), max_row);
            const double a = cx - i, b = cy - j;
            const std::int32_t at = j * stride + i;
            const double d00 = distances[at], d10 = distances[at + across], d01 = distances[at + down],
                         d11 = distances[at + down + across];
            inside[k] = (1 - b) * ((1 - a) * d00 + a * d10) + b * ((1 - a) * d01 + a * d11);
            ox[k] = (gx - cx) * cell, oy[k] = (gy - cy) * cell;
            m_per_px[k] = 2 * depth / focal;
            in_image[k] = seen ? 1 : 0;
            slope_x[n] = ((1 - b) * (d10 - d00) + b * (d11 - d01)) / cell;
            slope_y[n] = ((1 - a) * (d01 - d00) + a * (d11 - d10)) / cell;
            to_x[n] = x, to_y[n] = y, to_z[n] = z;
            pixel_x[n] = px, pixel_y[n] = py;
        }
        for (int k = 0; k < size; ++k) {  // few are beyond the map
            beyond[k] = ox[k] != 0 || oy[k] != 0 ? std::hypot(ox[k], oy[k]) : 0;
            if (beyond[k] == 0) continue;
            slope_x[first + k] -= ox[k] / beyond[k];
            slope_y[first + k] -= oy[k] / beyond[k];
        }
#pragma GCC ivdep
        for (int k = 0; k < size; ++k) {
            const double outside_m = radius[first + k] - (inside[k] - beyond[k]) * m_per_px[k];
            to_outside[first + k] = in_image[k] > 0 ? outside_m : 0;
        }
    }
}

}  // namespace kinevox::kernels::HWY_NAMESPACE

#ifdef KINEVOX_HAVE_HIGHWAY
HWY_AFTER_NAMESPACE();
#endif

#if !defined(KINEVOX_HAVE_HIGHWAY) || HWY_ONCE
namespace kinevox::kernels {

KINEVOX_EXPORT(measure_outside);

void measure_outside(const PinholeView& camera, const DistanceMapView& map, const BallList& balls,
                     double min_depth_m, const OutsideList& out) {
    if (map.distance && map.columns > 0 && map.rows > 0)
        KINEVOX_DISPATCH(measure_outside)(camera, map, balls, min_depth_m, out);
    else
        std::fill_n(out.outside_m, balls.count, 0.0);
}

}  // namespace kinevox::kernels
#endif
