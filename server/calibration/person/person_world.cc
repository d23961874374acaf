#include "server/calibration/person/person_world.h"

#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "common/to_eigen.h"
#include "server/calibration/person/silhouette_hull.h"

namespace kinevox {
namespace {

constexpr double kLeanStd_rad = 0.06;       // of a walking body's mean axis
constexpr double kFloorStdFraction = 0.02;  // of the height: of the lowest point of a hull, about the floor
constexpr double kUprightQuantile = 0.75, kTallQuantile = 0.97;  // of the heights of the hulls
constexpr int kMinHulls = 5;

double quantile(std::vector<double> values, double fraction) {
    std::sort(values.begin(), values.end());
    return values[static_cast<std::size_t>(fraction * static_cast<double>(values.size() - 1))];
}

std::vector<SilhouetteHull::Extent> extents(const std::vector<Camera>& cameras,
                                            const SilhouetteSet& silhouettes, Vec3 up) {
    std::vector<std::optional<SilhouetteHull::Extent>> all(silhouettes.frame_sets.size());
    oneapi::tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t m) {
        for (const SilhouetteMask& image : silhouettes.frame_sets[m])
            if (!image.empty() && image.truncated) return;  // head or feet may be missing
        const SilhouetteHull hull(cameras, silhouettes.frame_sets[m]);
        if (hull.usable()) all[m] = hull.extent(up);
    });
    std::vector<SilhouetteHull::Extent> found;
    for (const auto& extent : all)
        if (extent) found.push_back(*extent);
    return found;
}

// The floor's normal: the plane through the lowest points, with the body's axis as prior across the path.
Vec3 normal_of_floor(const std::vector<SilhouetteHull::Extent>& extents, Vec3 up, double height) {
    const Eigen::Vector3d axis = to_eigen(up);
    const Eigen::Vector3d side = axis.unitOrthogonal(), front = axis.cross(side);
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const auto& extent : extents) mean += to_eigen(extent.lowest) / static_cast<double>(extents.size());
    Eigen::Matrix2d square = Eigen::Matrix2d::Identity() / (kLeanStd_rad * kLeanStd_rad);
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    const double weight = 1 / std::pow(kFloorStdFraction * height, 2);
    for (const auto& extent : extents) {
        const Eigen::Vector3d p = to_eigen(extent.lowest) - mean;
        const Eigen::Vector2d flat(p.dot(side), p.dot(front));
        square += weight * flat * flat.transpose();
        right += weight * p.dot(axis) * flat;
    }
    const Eigen::Vector2d slope = square.ldlt().solve(right);
    const Eigen::Vector3d normal = (axis - slope(0) * side - slope(1) * front).normalized();
    return from_eigen(normal);
}

// Along the main direction of the subject's positions, and across it; in world lengths.
void measure_way(const std::vector<SilhouetteHull::Extent>& extents, PersonWorld& world) {
    std::vector<Vec3> positions;
    for (const auto& extent : extents)
        positions.push_back(world.world_from_solved(0.5 * (extent.lowest + extent.highest)));
    double xx = 0, xy = 0, yy = 0;
    Vec3 mean;
    for (const Vec3 p : positions) mean += p / static_cast<double>(positions.size());
    for (const Vec3 p : positions)
        xx += (p.x - mean.x) * (p.x - mean.x), xy += (p.x - mean.x) * (p.y - mean.y),
            yy += (p.y - mean.y) * (p.y - mean.y);
    const double angle = 0.5 * std::atan2(2 * xy, xx - yy);
    std::vector<double> along, across;
    for (const Vec3 p : positions) {
        along.push_back(std::cos(angle) * p.x + std::sin(angle) * p.y);
        across.push_back(std::cos(angle) * p.y - std::sin(angle) * p.x);
    }
    world.way_long_m = quantile(along, 0.97) - quantile(along, 0.03);
    world.way_wide_m = quantile(across, 0.97) - quantile(across, 0.03);
}

}  // namespace

std::optional<PersonWorld> person_world(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                                        Vec3 up_in_solved, double height_m) {
    Vec3 up = normalized(up_in_solved);
    std::vector<SilhouetteHull::Extent> found;
    PersonWorld world;
    for (int round = 0; round < 2; ++round) {
        found = extents(cameras, silhouettes, up);
        if (found.size() < kMinHulls) return std::nullopt;
        std::vector<double> heights;
        for (const auto& extent : found) heights.push_back(dot(extent.highest - extent.lowest, up));
        world.height_solved = quantile(heights, kUprightQuantile);
        world.uneven_height = quantile(heights, kTallQuantile) / quantile(heights, 0.5);
        if (!(world.height_solved > 0)) return std::nullopt;
        up = normal_of_floor(found, up, world.height_solved);
    }
    world.frame_sets = static_cast<int>(found.size());
    std::vector<double> floors;
    Vec3 middle;
    for (const auto& extent : found) {
        floors.push_back(dot(extent.lowest, up));
        middle += extent.lowest / static_cast<double>(found.size());
    }
    const double scale = height_m / world.height_solved, floor = quantile(floors, 0.5);
    // x: to the right of the first camera.
    const Vec3 right = cameras.front().camera_from_world.rotation.transposed() * Vec3{1, 0, 0};
    const Vec3 x = normalized(right - dot(right, up) * up), y = cross(up, x);
    world.world_from_solved.scale = scale;
    world.world_from_solved.target_from_source.rotation = {{x.x, x.y, x.z, y.x, y.y, y.z, up.x, up.y, up.z}};
    const Vec3 origin = middle - (dot(middle, up) - floor) * up;
    world.world_from_solved.target_from_source.translation =
        -(world.world_from_solved.target_from_source.rotation * (scale * origin));
    measure_way(found, world);
    return world;
}

}  // namespace kinevox
