#include "common/camera.h"

#include <algorithm>
#include <cmath>

namespace kinevox {
namespace {

double radial_factor(const Camera& c, double r2) {
    return 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
}

// Distortion of normalised image coordinates.
Vec2 distorted_point(const Camera& c, Vec2 p) {
    const double x = p.x, y = p.y, r2 = x * x + y * y, radial = radial_factor(c, r2);
    return {x * radial + 2 * c.p1 * x * y + c.p2 * (r2 + 2 * x * x),
            y * radial + c.p1 * (r2 + 2 * y * y) + 2 * c.p2 * x * y};
}

// The same, and its Jacobian d(distorted) / d(undistorted).
struct Distorted {
    Vec2 point;
    double dx_dx, dx_dy, dy_dx, dy_dy;
};

Distorted distort(const Camera& c, Vec2 p) {
    const double x = p.x, y = p.y;
    const double r2 = x * x + y * y;
    const double radial = radial_factor(c, r2);
    const double radial_by_r2 = c.k1 + r2 * (2 * c.k2 + r2 * 3 * c.k3);
    Distorted d;
    d.point = distorted_point(c, p);
    d.dx_dx = radial + 2 * x * x * radial_by_r2 + 2 * c.p1 * y + 6 * c.p2 * x;
    d.dx_dy = 2 * x * y * radial_by_r2 + 2 * c.p1 * x + 2 * c.p2 * y;
    d.dy_dx = d.dx_dy;
    d.dy_dy = radial + 2 * y * y * radial_by_r2 + 6 * c.p1 * y + 2 * c.p2 * x;
    return d;
}

double squared(Vec2 a) {
    return a.x * a.x + a.y * a.y;
}

// Newton's method with halved steps if a full one does not converge; a dozen rounds converge to rounding
// error for every invertible distortion.
Vec2 undistort(const Camera& c, Vec2 distorted) {
    Vec2 p = distorted;
    Distorted d = distort(c, p);
    Vec2 miss{distorted.x - d.point.x, distorted.y - d.point.y};
    for (int round = 0; round < 30 && squared(miss) > 1e-32; ++round) {
        const double determinant = d.dx_dx * d.dy_dy - d.dx_dy * d.dy_dx;
        // Beyond the radius at which the model folds over there is no inverse: step along the miss instead.
        const bool invertible = determinant > 1e-9;
        Vec2 step = invertible ? Vec2{(d.dy_dy * miss.x - d.dx_dy * miss.y) / determinant,
                                      (d.dx_dx * miss.y - d.dy_dx * miss.x) / determinant}
                               : miss;
        bool closer = false;
        for (int halving = 0; halving < 8 && !closer; ++halving) {
            const Vec2 tried{p.x + step.x, p.y + step.y};
            const Distorted there = distort(c, tried);
            const Vec2 left{distorted.x - there.point.x, distorted.y - there.point.y};
            if (squared(left) < squared(miss)) {
                p = tried, d = there, miss = left;
                closer = true;
            }
            step = {step.x / 2, step.y / 2};
        }
        if (!closer) break;
    }
    return p;
}

}  // namespace

std::optional<Vec2> Camera::project(Vec3 point_in_world) const {
    const Vec3 point_in_camera = camera_from_world * point_in_world;
    if (!(point_in_camera.z > 0)) return std::nullopt;
    const Vec2 p = distorted_point(
        *this, {point_in_camera.x / point_in_camera.z, point_in_camera.y / point_in_camera.z});
    return Vec2{fx * p.x + cx, fy * p.y + cy};
}

Ray Camera::ray_through(Vec2 pixel) const {
    const Vec2 p = undistort(*this, {(pixel.x - cx) / fx, (pixel.y - cy) / fy});
    const Rigid3 world_from_camera = camera_from_world.inverse();
    return {world_from_camera.translation, normalized(world_from_camera.rotation * Vec3{p.x, p.y, 1})};
}

const Camera* camera_named(std::span<const Camera> cameras, std::string_view name) {
    const auto found =
        std::find_if(cameras.begin(), cameras.end(), [&](const Camera& c) { return c.name == name; });
    return found == cameras.end() ? nullptr : &*found;
}

std::string camera_name_problem(std::string_view name) {
    if (name.empty()) return "is empty; give the camera a name";
    if (name.size() > 64) return "is longer than 64 characters; shorten it";
    if (name.front() == '.') return "begins with a dot; begin it with a letter";
    for (const char c : name)
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f || c == '/' || c == '\\' || c == ':')
            return "holds a slash, colon or control character; use letters, digits, '_' and '-'";
    return "";
}

}  // namespace kinevox
