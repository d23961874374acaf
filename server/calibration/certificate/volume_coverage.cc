#include "server/calibration/certificate/volume_coverage.h"

#include <algorithm>
#include <cmath>

namespace kinevox {
namespace {

constexpr int kCells = 10;                // along each axis
constexpr double kRadiusFraction = 0.15;  // of the box's diagonal

bool sees(const Camera& camera, Vec3 point) {
    const auto pixel = camera.project(point);
    return pixel && pixel->x >= -0.5 && pixel->y >= -0.5 && pixel->x < camera.width - 0.5 &&
           pixel->y < camera.height - 0.5;
}

}  // namespace

VolumeCoverage volume_coverage(const std::vector<Camera>& cameras, const std::vector<Vec3>& points,
                               Vec3 lower, Vec3 upper) {
    VolumeCoverage out;
    if (!(upper.x > lower.x && upper.y > lower.y && upper.z > lower.z)) {
        lower = {1e9, 1e9, 1e9}, upper = {-1e9, -1e9, -1e9};
        for (const Vec3 p : points) {
            lower = {std::min(lower.x, p.x), std::min(lower.y, p.y), std::min(lower.z, p.z)};
            upper = {std::max(upper.x, p.x), std::max(upper.y, p.y), std::max(upper.z, p.z)};
        }
    }
    out.lower = lower, out.upper = upper;
    if (points.empty() && !(upper.x > lower.x)) return out;
    const Vec3 size = upper - lower;
    const double radius = kRadiusFraction * norm(size);
    int two = 0, three = 0, near = 0;
    for (int i = 0; i < kCells * kCells * kCells; ++i) {
        const Vec3 p{lower.x + size.x * (i % kCells + 0.5) / kCells,
                     lower.y + size.y * (i / kCells % kCells + 0.5) / kCells,
                     lower.z + size.z * (i / kCells / kCells + 0.5) / kCells};
        const auto count =
            std::count_if(cameras.begin(), cameras.end(), [&](const Camera& c) { return sees(c, p); });
        two += count >= 2, three += count >= 3;
        near += std::any_of(points.begin(), points.end(), [&](Vec3 q) { return norm(p - q) < radius; });
    }
    const double all = kCells * kCells * kCells;
    out.two_view_fraction = two / all, out.three_view_fraction = three / all,
    out.calibrated_fraction = near / all;
    return out;
}

std::optional<VolumeCoverage> working_volume(const std::vector<Camera>& cameras,
                                             const std::vector<Vec3>& points) {
    constexpr double kRadius_m = 2.0;  // of a person's hands
    if (points.size() < 3) return std::nullopt;
    Vec3 lower{1e9, 1e9, 0}, upper{-1e9, -1e9, kRadius_m};
    for (const Vec3 p : points) {
        lower = {std::min(lower.x, p.x), std::min(lower.y, p.y), 0};
        upper = {std::max(upper.x, p.x), std::max(upper.y, p.y), std::max(upper.z, p.z)};
    }
    return volume_coverage(cameras, points, lower, upper);
}

}  // namespace kinevox
