#include "server/pipeline/tracking/subject_centre.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "common/to_eigen.h"

namespace kinevox {
namespace {

constexpr double kMinDepth_m = 0.2;    // in front of a camera
constexpr double kMinPairSine = 0.12;  // about 7 degrees between two rays that propose a point

// The midpoint of the shortest segment between two rays; empty if they are nearly parallel or intersect
// behind a camera.
std::optional<Vec3> midpoint_of(const Ray& a, const Ray& b) {
    const Vec3 between = b.origin_in_world - a.origin_in_world;
    const double cosine = dot(a.direction_in_world, b.direction_in_world);
    const double sine2 = 1 - cosine * cosine;
    if (sine2 < kMinPairSine * kMinPairSine) return std::nullopt;
    const double ta = dot(between, a.direction_in_world), tb = dot(between, b.direction_in_world);
    const double s = (ta - cosine * tb) / sine2, t = (cosine * ta - tb) / sine2;
    if (s < kMinDepth_m || t < kMinDepth_m) return std::nullopt;
    return 0.5 *
           (a.origin_in_world + s * a.direction_in_world + b.origin_in_world + t * b.direction_in_world);
}

struct Vote {
    double score = 0;
    std::vector<int> chosen;
    int inlier_count = 0;
};

// The vote of one candidate for a point, 0 for an outlier.
double vote_of(const RayCandidate& candidate, Vec3 point, const RayIntersectionOptions& options) {
    const double depth = dot(point - candidate.ray.origin_in_world, candidate.ray.direction_in_world);
    if (depth < kMinDepth_m) return 0;
    const double tolerance = candidate.truncated ? options.truncated_tolerance_m : options.tolerance_m;
    const double off = distance_to_ray(candidate.ray, point) / tolerance;
    if (off > 1) return 0;
    const double pixel_m = candidate.metres_per_pixel * depth;
    const double area_m2 = candidate.area_px * pixel_m * pixel_m;
    if (area_m2 < options.min_area_m2 || area_m2 > options.max_area_m2) return 0;
    const double size = std::min(1.0, std::sqrt(area_m2 / options.subject_area_m2));
    return size * (1 - 0.5 * off * off) * (candidate.truncated ? 0.5 : 1.0);
}

Vote vote(const std::vector<RayCandidate>& candidates, int camera_count, Vec3 point,
          const RayIntersectionOptions& options) {
    Vote result;
    result.chosen.assign(camera_count, -1);
    std::vector<double> best(camera_count, 0);
    for (int n = 0; n < static_cast<int>(candidates.size()); ++n) {
        const double score = vote_of(candidates[n], point, options);
        if (score > best[candidates[n].camera])
            best[candidates[n].camera] = score, result.chosen[candidates[n].camera] = n;
    }
    for (int camera = 0; camera < camera_count; ++camera) {
        if (result.chosen[camera] < 0) continue;
        result.score += best[camera];
        ++result.inlier_count;
    }
    return result;
}

// Least squares over the chosen rays, weighted by their distance from `point`, which is updated. False if
// they determine no point.
bool refine_once(const std::vector<RayCandidate>& candidates, const std::vector<int>& chosen,
                 const RayIntersectionOptions& options, Vec3& point, Mat3& covariance) {
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const int n : chosen) {
        if (n < 0) continue;
        const double std_m = options.ray_std_m * (candidates[n].truncated ? 6.0 : 1.0);
        const double off = distance_to_ray(candidates[n].ray, point) / (2 * std_m);
        const Eigen::Vector3d d = to_eigen(candidates[n].ray.direction_in_world);
        const Eigen::Matrix3d across =
            (Eigen::Matrix3d::Identity() - d * d.transpose()) / (std_m * std_m * (1 + off * off));
        information += across;
        right += across * to_eigen(candidates[n].ray.origin_in_world);
    }
    const Eigen::LDLT<Eigen::Matrix3d> solver(information);
    if (solver.info() != Eigen::Success || solver.vectorD().minCoeff() < 1e-6 * solver.vectorD().maxCoeff())
        return false;
    const Eigen::Vector3d x = solver.solve(right);
    const Eigen::Matrix3d c = solver.solve(Eigen::Matrix3d::Identity());
    point = {x.x(), x.y(), x.z()};
    for (int r = 0; r < 3; ++r)
        for (int k = 0; k < 3; ++k) covariance(r, k) = c(r, k);
    return true;
}

bool refine(const std::vector<RayCandidate>& candidates, const std::vector<int>& chosen,
            const RayIntersectionOptions& options, Vec3& point, Mat3& covariance) {
    constexpr int kRounds = 8;
    for (int round = 0; round < kRounds; ++round) {
        const Vec3 before = point;
        if (!refine_once(candidates, chosen, options, point, covariance)) return false;
        if (norm(point - before) < 1e-4) break;
    }
    return true;
}

}  // namespace

double distance_to_ray(const Ray& ray, Vec3 point_in_world) {
    return norm(cross(point_in_world - ray.origin_in_world, ray.direction_in_world));
}

std::optional<RayIntersection> intersect_rays(const std::vector<RayCandidate>& candidates, int camera_count,
                                              const RayIntersectionOptions& options, const Vec3* prior,
                                              double prior_radius_m) {
    std::optional<Vec3> best_point;
    Vote best;
    const auto consider = [&](Vec3 point) {
        if (prior && norm(point - *prior) > prior_radius_m) return;
        Vote found = vote(candidates, camera_count, point, options);
        if (found.inlier_count >= 2 && found.score > best.score) best = std::move(found), best_point = point;
    };
    for (std::size_t a = 0; a < candidates.size(); ++a)
        for (std::size_t b = a + 1; b < candidates.size(); ++b) {
            if (candidates[a].camera == candidates[b].camera) continue;
            if (const auto point = midpoint_of(candidates[a].ray, candidates[b].ray)) consider(*point);
        }
    if (!best_point) return std::nullopt;

    // The refined point may gain or lose inliers; a few rounds converge.
    RayIntersection found{*best_point, {}, best.score, best.chosen, best.inlier_count};
    for (int round = 0; round < 3; ++round) {
        Vec3 point = found.point_in_world;
        if (!refine(candidates, found.chosen, options, point, found.covariance_m2)) return std::nullopt;
        Vote again = vote(candidates, camera_count, point, options);
        if (again.inlier_count < 2) break;
        found.point_in_world = point;
        found.score = again.score;
        found.inlier_count = again.inlier_count;
        if (again.chosen == found.chosen) break;
        found.chosen = std::move(again.chosen);
    }
    return found;
}

namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using RowMatrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

}  // namespace

void CentreFilter::start(Vec3 centre_in_world, const Mat3& covariance_m2) {
    state_ = {centre_in_world.x, centre_in_world.y, centre_in_world.z, 0, 0, 0};
    Eigen::Map<Matrix6> p(covariance_.data());
    p.setZero();
    p.topLeftCorner<3, 3>() = Eigen::Map<const RowMatrix3>(covariance_m2.m.data());
    p.bottomRightCorner<3, 3>().diagonal().setConstant(options_.initial_speed_std_m_per_s *
                                                       options_.initial_speed_std_m_per_s);
}

void CentreFilter::predict(double seconds) {
    const double t = std::max(seconds, 0.0),
                 q = options_.acceleration_std_m_per_s2 * options_.acceleration_std_m_per_s2;
    Eigen::Map<Vector6> x(state_.data());
    Eigen::Map<Matrix6> p(covariance_.data());
    Matrix6 f = Matrix6::Identity();
    f.topRightCorner<3, 3>().diagonal().setConstant(t);
    x = f * x;
    // An acceleration that is constant over one step: position t^2/2, velocity t.
    Matrix6 noise = Matrix6::Zero();
    noise.topLeftCorner<3, 3>().diagonal().setConstant(q * t * t * t * t / 4);
    noise.topRightCorner<3, 3>().diagonal().setConstant(q * t * t * t / 2);
    noise.bottomLeftCorner<3, 3>().diagonal().setConstant(q * t * t * t / 2);
    noise.bottomRightCorner<3, 3>().diagonal().setConstant(q * t * t);
    p = (f * p * f.transpose() + noise).eval();
}

void CentreFilter::correct(Vec3 centre_in_world, const Mat3& covariance_m2) {
    Eigen::Map<Vector6> x(state_.data());
    Eigen::Map<Matrix6> p(covariance_.data());
    const RowMatrix3 r = Eigen::Map<const RowMatrix3>(covariance_m2.m.data());
    const Eigen::Vector3d measured(centre_in_world.x, centre_in_world.y, centre_in_world.z);
    const Eigen::Matrix3d innovation = p.topLeftCorner<3, 3>() + r;
    const Eigen::Matrix<double, 6, 3> gain = p.leftCols<3>() * innovation.inverse();
    x += gain * (measured - x.head<3>());
    Matrix6 keep = Matrix6::Identity();
    keep.leftCols<3>() -= gain;
    p = (keep * p * keep.transpose() + gain * r * gain.transpose()).eval();  // Joseph: stays symmetric
}

Vec3 CentreFilter::centre_in_world() const {
    return {state_[0], state_[1], state_[2]};
}
Vec3 CentreFilter::velocity_in_world() const {
    return {state_[3], state_[4], state_[5]};
}

double CentreFilter::centre_std_m() const {
    return std::sqrt((covariance_[0] + covariance_[7] + covariance_[14]) / 3);
}

}  // namespace kinevox
