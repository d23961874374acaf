#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "common/to_eigen.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/person/silhouette_residuals.h"
#include "server/cameras/image_mat.h"

namespace kinevox {
namespace {

constexpr double kMinOffAxis = 0.17;   // closer to the baseline a plane is unreliable
constexpr double kMaxAngle_rad = 2.4;  // a silhouette that covers more has the other camera behind it
constexpr std::size_t kBlock = 8;      // frame sets summed together: makes the sum independent of the threads

}  // namespace

SilhouetteTangents::SilhouetteTangents(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes)
    : shapes_(silhouettes.frame_sets.size(), std::vector<Shape>(cameras.size())) {
    oneapi::tbb::parallel_for(std::size_t{0}, shapes_.size(), [&](std::size_t m) {
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            const SilhouetteMask& image = silhouettes.frame_sets[m][c];
            if (image.empty()) continue;
            const Camera& camera = cameras[c];
            const cv::Mat mask = as_mat(image.mask.data(), camera.width, camera.height);
            // The outer edges of each row's first and last pixel span the convex hull.
            std::vector<cv::Point2f> ends, hull;
            for (int y = 0; y < camera.height; ++y) {
                const auto* const row = mask.ptr<std::uint8_t>(y);
                const auto* const stop = row + camera.width;
                const auto* const begin = std::find_if(row, stop, [](std::uint8_t v) { return v != 0; });
                if (begin == stop) continue;
                const auto* end = stop - 1;
                while (*end == 0) --end;
                const auto left = static_cast<float>(begin - row), right = static_cast<float>(end - row);
                const auto at = static_cast<float>(y);
                for (const cv::Point2f p : {cv::Point2f(left - 0.5f, at), cv::Point2f(right + 0.5f, at),
                                            cv::Point2f(left, at - 0.5f), cv::Point2f(right, at - 0.5f),
                                            cv::Point2f(left, at + 0.5f), cv::Point2f(right, at + 0.5f)})
                    ends.push_back(p);
            }
            if (ends.empty()) continue;
            cv::convexHull(ends, hull);
            for (const cv::Point2f p : hull) {
                shapes_[m][c].directions_in_camera.push_back(direction_in_camera(camera, {p.x, p.y}));
                shapes_[m][c].at_border.push_back(p.x < 1 || p.y < 1 ||
                                                  p.x > static_cast<float>(camera.width - 2) ||
                                                  p.y > static_cast<float>(camera.height - 2));
            }
        }
    });
}

void SilhouetteTangents::touch(const Shape& shape, const Camera& camera, Vec3 axis, Vec3 reference,
                               Touch (&ends)[2]) {
    const Mat3& rotation = camera.camera_from_world.rotation;
    // In the camera frame: two dot products per direction instead of a rotation.
    const Vec3 u = rotation * reference, v = rotation * cross(axis, reference);
    double min_angle = 10, max_angle = -10;
    std::size_t first = 0, last = 0;
    for (std::size_t i = 0; i < shape.directions_in_camera.size(); ++i) {
        const Vec3 d = shape.directions_in_camera[i];
        const double angle = std::atan2(dot(v, d), dot(u, d));
        if (angle < min_angle) min_angle = angle, first = i;
        if (angle > max_angle) max_angle = angle, last = i;
    }
    if (max_angle - min_angle > kMaxAngle_rad) return;
    for (const int k : {0, 1}) {
        const std::size_t i = k == 0 ? first : last;
        if (shape.at_border[i]) continue;
        const Vec3 in_world = rotation.transposed() * shape.directions_in_camera[i];
        const double off_axis = norm(cross(axis, in_world));
        if (off_axis > kMinOffAxis) ends[k] = {&shape.directions_in_camera[i], in_world, off_axis};
    }
}

void SilhouetteTangents::add_pair(const std::vector<Camera>& cameras, std::size_t frame_set, int a, int b,
                                  double scale2, bool with_derivatives, PoseNormalEquations& part,
                                  std::vector<double>& counts) const {
    const Shape &in_a = shapes_[frame_set][a], &in_b = shapes_[frame_set][b];
    if (in_a.directions_in_camera.empty() || in_b.directions_in_camera.empty()) return;
    const Vec3 base = cameras[b].centre_in_world() - cameras[a].centre_in_world();
    const double distance = norm(base);
    if (!(distance > 1e-6)) return;
    const Vec3 axis = base / distance;
    // Any direction of the first camera's silhouette defines angle zero.
    const Vec3 some = cameras[a].camera_from_world.rotation.transposed() *
                      in_a.directions_in_camera[in_a.directions_in_camera.size() / 2];
    const Vec3 across = some - dot(some, axis) * axis;
    if (!(norm(across) > 0.05)) return;
    const Vec3 reference = normalized(across);
    Touch at_a[2], at_b[2];
    touch(in_a, cameras[a], axis, reference, at_a);
    touch(in_b, cameras[b], axis, reference, at_b);
    for (const int k : {0, 1}) {
        if (!at_a[k].direction_in_camera || !at_b[k].direction_in_camera) continue;
        const Vec3 d = at_a[k].direction_in_world, f = at_b[k].direction_in_world;
        // Rotation of the plane per pixel in either image.
        const double radians_per_px_a = 1 / (cameras[a].fx * at_a[k].off_axis),
                     radians_per_px_b = 1 / (cameras[b].fx * at_b[k].off_axis);
        const double factor =
            1 / (std::hypot(radians_per_px_a, radians_per_px_b) * at_a[k].off_axis * at_b[k].off_axis);
        const Vec3 normal = cross(d, f);
        const double residual = factor * dot(axis, normal);
        const double ratio = scale2 / (scale2 + residual * residual);
        part.cost += residual * residual * ratio;
        const double robust = std::abs(residual) * std::sqrt(ratio);
        part.camera_cost[a] += robust, part.camera_cost[b] += robust;
        ++counts[a], ++counts[b];
        if (!with_derivatives) continue;
        // The tangent point moves along the contour as cameras move, which has no effect to
        // first order.
        const Mat3 &rotation_of_a = cameras[a].camera_from_world.rotation,
                   &rotation_of_b = cameras[b].camera_from_world.rotation;
        const Vec3 rows[4] = {cross(rotation_of_a * cross(f, axis), *at_a[k].direction_in_camera),
                              (1 / distance) * (rotation_of_a * normal),
                              cross(rotation_of_b * cross(axis, d), *at_b[k].direction_in_camera),
                              (-1 / distance) * (rotation_of_b * normal)};
        Eigen::Matrix<double, 12, 1> by;
        for (int i = 0; i < 4; ++i) by.segment<3>(3 * i) = factor * to_eigen(rows[i]);
        const double weight = ratio * ratio;
        const int start[2] = {6 * a, 6 * b};
        for (int i = 0; i < 2; ++i) {
            part.right.segment<6>(start[i]) -= weight * residual * by.segment<6>(6 * i);
            for (int j = 0; j < 2; ++j)
                part.square.block<6, 6>(start[i], start[j]) +=
                    weight * by.segment<6>(6 * i) * by.segment<6>(6 * j).transpose();
        }
    }
}

PoseNormalEquations SilhouetteTangents::measure(const std::vector<Camera>& cameras, double scale_px,
                                                bool with_derivatives, std::size_t first,
                                                std::size_t last) const {
    const int count = static_cast<int>(cameras.size()), size = 6 * count;
    const std::size_t blocks = (last - first + kBlock - 1) / kBlock;
    std::vector<PoseNormalEquations> parts(blocks);
    std::vector<std::vector<double>> seen(blocks, std::vector<double>(count, 0));
    const double scale2 = scale_px * scale_px;
    oneapi::tbb::parallel_for(std::size_t{0}, blocks, [&](std::size_t block) {
        PoseNormalEquations& part = parts[block];
        part.camera_cost.assign(count, 0);
        if (with_derivatives) part.square.setZero(size, size), part.right.setZero(size);
        for (std::size_t m = first + block * kBlock; m < std::min(last, first + (block + 1) * kBlock); ++m)
            for (int a = 0; a < count; ++a)
                for (int b = a + 1; b < count; ++b)
                    add_pair(cameras, m, a, b, scale2, with_derivatives, part, seen[block]);
    });
    PoseNormalEquations sum;
    sum.camera_cost.assign(count, 0);
    if (with_derivatives) sum.square.setZero(size, size), sum.right.setZero(size);
    std::vector<double> all(count, 0);
    for (std::size_t block = 0; block < blocks; ++block) {
        sum.cost += parts[block].cost;
        for (int c = 0; c < count; ++c)
            sum.camera_cost[c] += parts[block].camera_cost[c], all[c] += seen[block][c];
        if (with_derivatives) sum.square += parts[block].square, sum.right += parts[block].right;
    }
    for (int c = 0; c < count; ++c) sum.camera_cost[c] /= std::max(1.0, all[c]);
    return sum;
}

}  // namespace kinevox
