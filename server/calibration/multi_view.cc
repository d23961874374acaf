#include "server/calibration/multi_view.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "common/to_eigen.h"

namespace kinevox {

Vec3 direction_in_camera(Camera camera, Vec2 pixel) {
    camera.camera_from_world = {};
    return camera.ray_through(pixel).direction_in_world;
}

std::optional<Vec3> triangulate(const std::vector<Observation>& observations) {
    if (observations.size() < 2) return std::nullopt;
    Eigen::Matrix3d across = Eigen::Matrix3d::Zero();
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Observation& observation : observations) {
        const Ray ray = observation.camera->ray_through(observation.pixel);
        const Eigen::Vector3d d = to_eigen(ray.direction_in_world);
        const Eigen::Matrix3d m = Eigen::Matrix3d::Identity() - d * d.transpose();
        across += m;
        sum += m * to_eigen(ray.origin_in_world);
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigenvalues(across);
    if (!(eigenvalues.eigenvalues()(0) > 1e-4)) return std::nullopt;  // the rays are parallel
    Vec3 point = from_eigen(across.ldlt().solve(sum));
    constexpr double kStep = 1e-5;
    for (int round = 0; round < 4; ++round) {
        Eigen::Matrix3d square = Eigen::Matrix3d::Zero();
        Eigen::Vector3d right = Eigen::Vector3d::Zero();
        for (const Observation& observation : observations) {
            const auto here = observation.camera->project(point);
            if (!here) return std::nullopt;
            Eigen::Matrix<double, 2, 3> jacobian;
            for (int axis = 0; axis < 3; ++axis) {
                Vec3 moved = point;
                (axis == 0 ? moved.x : axis == 1 ? moved.y : moved.z) += kStep;
                const auto there = observation.camera->project(moved);
                if (!there) return std::nullopt;
                jacobian.col(axis) << (there->x - here->x) / kStep, (there->y - here->y) / kStep;
            }
            const Eigen::Vector2d residual(observation.pixel.x - here->x, observation.pixel.y - here->y);
            square += jacobian.transpose() * jacobian;
            right += jacobian.transpose() * residual;
        }
        const Eigen::Vector3d step = square.ldlt().solve(right);
        if (!step.allFinite() || step.norm() > 1) return std::nullopt;
        point += from_eigen(step);
    }
    return point;
}

std::optional<SimilarityTransform> align_points(const std::vector<Vec3>& from, const std::vector<Vec3>& to,
                                                bool with_scale) {
    if (from.size() != to.size() || from.size() < 3) return std::nullopt;
    Eigen::Matrix3Xd a(3, from.size()), b(3, to.size());
    for (std::size_t i = 0; i < from.size(); ++i) a.col(i) = to_eigen(from[i]), b.col(i) = to_eigen(to[i]);
    const Eigen::Matrix4d t = Eigen::umeyama(a, b, with_scale);
    if (!t.allFinite()) return std::nullopt;
    SimilarityTransform out;
    const Eigen::Matrix3d linear = t.topLeftCorner<3, 3>();
    out.scale = std::cbrt(linear.determinant());
    for (int i = 0; i < 9; ++i) out.target_from_source.rotation.m[i] = linear(i / 3, i % 3) / out.scale;
    out.target_from_source.translation = from_eigen(t.topRightCorner<3, 1>());
    return out;
}

void move_cameras(const SimilarityTransform& new_from_old, std::vector<Camera>& cameras) {
    for (Camera& camera : cameras) {
        const Vec3 centre = new_from_old(camera.centre_in_world());
        const Mat3 rotation =
            camera.camera_from_world.rotation * new_from_old.target_from_source.rotation.transposed();
        camera.camera_from_world = {rotation, -(rotation * centre)};
    }
}

double angle_between(const Mat3& a, const Mat3& b) {
    return norm(rodrigues_from_rotation(a.transposed() * b));
}

CameraTree join_cameras(int cameras, std::vector<CameraPair> pairs) {
    std::stable_sort(pairs.begin(), pairs.end(),
                     [](const CameraPair& x, const CameraPair& y) { return x.votes > y.votes; });
    std::vector<int> group(cameras), votes(cameras, 0);
    std::iota(group.begin(), group.end(), 0);
    std::vector<std::vector<std::pair<int, Rigid3>>> next(cameras);  // [from]: to, target_from_source
    for (const CameraPair& pair : pairs) {
        votes[pair.a] += pair.votes, votes[pair.b] += pair.votes;
        if (group[pair.a] == group[pair.b]) continue;
        std::replace(group.begin(), group.end(), int{group[pair.b]}, int{group[pair.a]});
        next[pair.b].emplace_back(pair.a, pair.a_from_b);
        next[pair.a].emplace_back(pair.b, pair.a_from_b.inverse());
    }
    CameraTree tree;
    tree.camera_from_world.resize(cameras);
    for (int id = 0; id < cameras; ++id) {
        std::vector<int> members;
        for (int c = 0; c < cameras; ++c)
            if (group[c] == id) members.push_back(c);
        if (members.empty()) continue;
        int root = members.front();
        for (const int c : members)
            if (votes[c] > votes[root]) root = c;
        std::vector<int> open{root};
        std::vector<bool> done(cameras, false);
        done[root] = true;
        tree.camera_from_world[root] = {};
        for (std::size_t i = 0; i < open.size(); ++i)
            for (const auto& [to, target_from_source] : next[open[i]]) {
                if (done[to]) continue;
                done[to] = true;
                tree.camera_from_world[to] = target_from_source * tree.camera_from_world[open[i]];
                open.push_back(to);
            }
        tree.groups.push_back(std::move(members));
    }
    std::stable_sort(tree.groups.begin(), tree.groups.end(),
                     [](const auto& x, const auto& y) { return x.size() > y.size(); });
    return tree;
}

}  // namespace kinevox
