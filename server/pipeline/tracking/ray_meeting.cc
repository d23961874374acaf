#include "server/pipeline/tracking/ray_meeting.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "common/to_eigen.h"

namespace kinevox {
namespace {

constexpr double kNearest_m = 0.2;     // in front of a camera
constexpr double kMinPairSine = 0.12;  // about 7 degrees between two rays that propose a point

// The middle of the shortest segment between two rays; nothing if they are near parallel or meet behind a
// camera.
std::optional<Vec3> middle_of(const Ray& a, const Ray& b) {
    const Vec3 between = b.origin_in_world - a.origin_in_world;
    const double cosine = dot(a.direction_in_world, b.direction_in_world);
    const double sine2 = 1 - cosine * cosine;
    if (sine2 < kMinPairSine * kMinPairSine) return std::nullopt;
    const double ta = dot(between, a.direction_in_world), tb = dot(between, b.direction_in_world);
    const double s = (ta - cosine * tb) / sine2, t = (cosine * ta - tb) / sine2;
    if (s < kNearest_m || t < kNearest_m) return std::nullopt;
    return 0.5 *
           (a.origin_in_world + s * a.direction_in_world + b.origin_in_world + t * b.direction_in_world);
}

struct Vote {
    double score = 0;
    std::vector<int> chosen;
    int agreeing = 0;
};

// The vote of one candidate for a point, 0 if it disagrees.
double vote_of(const RayCandidate& candidate, Vec3 point, const MeetingOptions& options) {
    const double depth = dot(point - candidate.ray.origin_in_world, candidate.ray.direction_in_world);
    if (depth < kNearest_m) return 0;
    const double tolerance = candidate.partial ? options.partial_tolerance_m : options.tolerance_m;
    const double off = distance_to_ray(candidate.ray, point) / tolerance;
    if (off > 1) return 0;
    const double pixel_m = candidate.metres_per_pixel * depth;
    const double area_m2 = candidate.area_px * pixel_m * pixel_m;
    if (area_m2 < options.min_area_m2 || area_m2 > options.max_area_m2) return 0;
    const double size = std::min(1.0, std::sqrt(area_m2 / options.subject_area_m2));
    return size * (1 - 0.5 * off * off) * (candidate.partial ? 0.5 : 1.0);
}

Vote vote(const std::vector<RayCandidate>& candidates, int camera_count, Vec3 point,
          const MeetingOptions& options) {
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
        ++result.agreeing;
    }
    return result;
}

// Least squares over the chosen rays, weighted by how far they pass `point`, which is then moved. False if
// they fix no point.
bool refine_once(const std::vector<RayCandidate>& candidates, const std::vector<int>& chosen,
                 const MeetingOptions& options, Vec3& point, Mat3& covariance) {
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const int n : chosen) {
        if (n < 0) continue;
        const double std_m = options.ray_std_m * (candidates[n].partial ? 6.0 : 1.0);
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
            const MeetingOptions& options, Vec3& point, Mat3& covariance) {
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

std::optional<Meeting> meet_rays(const std::vector<RayCandidate>& candidates, int camera_count,
                                 const MeetingOptions& options, const Vec3* prior, double prior_radius_m) {
    std::optional<Vec3> best_point;
    Vote best;
    const auto consider = [&](Vec3 point) {
        if (prior && norm(point - *prior) > prior_radius_m) return;
        Vote found = vote(candidates, camera_count, point, options);
        if (found.agreeing >= 2 && found.score > best.score) best = std::move(found), best_point = point;
    };
    for (std::size_t a = 0; a < candidates.size(); ++a)
        for (std::size_t b = a + 1; b < candidates.size(); ++b) {
            if (candidates[a].camera == candidates[b].camera) continue;
            if (const auto point = middle_of(candidates[a].ray, candidates[b].ray)) consider(*point);
        }
    if (!best_point) return std::nullopt;

    // The refined point may win or lose a ray; twice is enough to settle.
    Meeting meeting{*best_point, {}, best.score, best.chosen, best.agreeing};
    for (int round = 0; round < 3; ++round) {
        Vec3 point = meeting.point_in_world;
        if (!refine(candidates, meeting.chosen, options, point, meeting.covariance_m2)) return std::nullopt;
        Vote again = vote(candidates, camera_count, point, options);
        if (again.agreeing < 2) break;
        meeting.point_in_world = point;
        meeting.score = again.score;
        meeting.agreeing = again.agreeing;
        if (again.chosen == meeting.chosen) break;
        meeting.chosen = std::move(again.chosen);
    }
    return meeting;
}

}  // namespace kinevox
