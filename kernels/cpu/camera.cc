#include "kernels/shared/camera.h"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace kinevox::kernels {
namespace {

// Radius in normalised coordinates after radial distortion, and its derivative.
double distorted_radius(const Projector& c, double r) {
    const double r2 = r * r;
    return r * (1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3)));
}

double distorted_slope(const Projector& c, double r) {
    const double r2 = r * r;
    return 1 + r2 * (3 * c.k1 + r2 * (5 * c.k2 + r2 * 7 * c.k3));
}

}  // namespace

Projector make_projector(const CameraModel& camera, const char* what) {
    const std::string name = what;
    if (camera.width <= 0 || camera.height <= 0 || camera.width > 30000 || camera.height > 30000) {
        throw std::invalid_argument(name + ": image size " + std::to_string(camera.width) + " x " +
                                    std::to_string(camera.height) + " is not between 1 and 30000");
    }
    Projector c;
    c.width = camera.width;
    c.height = camera.height;
    std::copy_n(camera.rotation_camera_from_world, 9, c.r);
    std::copy_n(camera.translation_camera_from_world, 3, c.t);
    c.fx = camera.fx, c.fy = camera.fy, c.cx = camera.cx, c.cy = camera.cy;
    c.k1 = camera.k1, c.k2 = camera.k2, c.p1 = camera.p1, c.p2 = camera.p2, c.k3 = camera.k3;
    double sum = c.fx + c.fy + c.cx + c.cy + c.k1 + c.k2 + c.p1 + c.p2 + c.k3;
    for (float value : c.r) sum += value;
    for (float value : c.t) sum += value;
    if (!std::isfinite(sum))
        throw std::invalid_argument(name + ": calibration has a value that is not finite");
    if (!(c.fx > 0 && c.fy > 0)) throw std::invalid_argument(name + ": focal length must be positive");

    c.distorted = c.k1 != 0 || c.k2 != 0 || c.p1 != 0 || c.p2 != 0 || c.k3 != 0;
    if (!c.distorted) {
        c.max_radius2 = 1e6f;
        return c;
    }
    // Walk outwards until the farthest corner is passed or the polynomial stops growing.
    const double far_x = std::max<double>(c.cx + 1, c.width - c.cx) / c.fx;
    const double far_y = std::max<double>(c.cy + 1, c.height - c.cy) / c.fy;
    const double corner = std::hypot(far_x, far_y);
    double radius = 0, stretch = 1;
    for (double r = 0; r < 4 * corner + 1; r += corner / 512) {
        const double slope = distorted_slope(c, r);
        if (slope < 0.05) break;
        radius = r;
        const double tangential = 6 * r * (std::fabs(c.p1) + std::fabs(c.p2));
        stretch =
            std::max({stretch, slope + tangential, r > 0 ? distorted_radius(c, r) / r + tangential : 1.0});
        if (distorted_radius(c, r) > 1.05 * corner) break;
    }
    c.max_radius2 = static_cast<float>(radius * radius);
    c.stretch = static_cast<float>(stretch);
    return c;
}

}  // namespace kinevox::kernels
