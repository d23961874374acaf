#include "server/calibration/board/floor.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "common/geometry.h"
#include "server/calibration/board/posed_views.h"
#include "server/calibration/bundle.h"
#include "server/calibration/multi_view.h"

namespace kinevox {
namespace {

constexpr double kMinTriangle_m = 0.05;  // minimum height of the triangle that three points span
constexpr double kGoodClick_px = 3, kBadClick_px = 10;
constexpr double kGoodScale = 0.01, kBadScale = 0.03;
constexpr double kFlat_mm = 15;

struct Fit {
    Rigid3 old_from_world;
    double rms_px = 1e9;
    std::vector<double> errors_px;
};

// Pose of `points_in_world` from the observations of fixed cameras.
std::optional<Fit> fitted(const std::vector<Camera>& cameras, const std::vector<Vec3>& points_in_world,
                          const std::vector<BundleObservation>& observations, const Rigid3& start) {
    Bundle bundle;
    bundle.cameras = cameras;
    bundle.points_in_target = points_in_world;
    bundle.world_from_target = {start};
    bundle.observations = observations;
    BundleOptions options;
    options.fixed_cameras = true;
    BundleReport report;
    if (!solve_bundle(bundle, options, report).ok() || !std::isfinite(report.rms_px)) return std::nullopt;
    for (const double error : report.errors_px)
        if (!std::isfinite(error)) return std::nullopt;
    return Fit{bundle.world_from_target.front(), report.rms_px, report.errors_px};
}

int above_floor(const std::vector<Camera>& cameras, const Rigid3& world_from_old) {
    return static_cast<int>(std::count_if(cameras.begin(), cameras.end(), [&](const Camera& camera) {
        return (world_from_old * camera.centre_in_world()).z > 0;
    }));
}

// The height of the largest triangle over its longest side.
double triangle_height(const std::vector<Vec3>& points) {
    double best = 0;
    for (const Vec3 a : points)
        for (const Vec3 b : points)
            for (const Vec3 c : points) {
                const double longest = std::max({norm(a - b), norm(b - c), norm(c - a)});
                if (longest > 0) best = std::max(best, norm(cross(b - a, c - a)) / longest);
            }
    return best;
}

// World frames from three or more known points in one camera.
std::vector<Rigid3> candidates_of(const Camera& camera, const std::vector<Vec3>& in_world,
                                  const std::vector<Vec2>& seen) {
    std::vector<cv::Point3d> points;
    std::vector<cv::Point2d> on_plane;
    for (std::size_t i = 0; i < seen.size(); ++i) {
        const Vec3 d = direction_in_camera(camera, seen[i]);
        points.emplace_back(in_world[i].x, in_world[i].y, in_world[i].z);
        on_plane.emplace_back(d.x / d.z, d.y / d.z);
    }
    std::vector<cv::Mat> rotations, translations;
    try {
        if (points.size() == 3) {
            cv::solveP3P(points, on_plane, cv::Mat::eye(3, 3, CV_64F), cv::noArray(), rotations, translations,
                         cv::SOLVEPNP_AP3P);
        } else if (points.size() > 3) {
            cv::solvePnPGeneric(points, on_plane, cv::Mat::eye(3, 3, CV_64F), cv::noArray(), rotations,
                                translations, false, cv::SOLVEPNP_SQPNP);
        }
    } catch (const cv::Exception&) {
        return {};
    }
    std::vector<Rigid3> out;
    for (std::size_t i = 0; i < rotations.size(); ++i) {
        const cv::Mat &r = rotations[i], &t = translations[i];
        const Rigid3 camera_from_world{
            rotation_from_rodrigues({r.at<double>(0), r.at<double>(1), r.at<double>(2)}),
            {t.at<double>(0), t.at<double>(1), t.at<double>(2)}};
        out.push_back(camera.camera_from_world.inverse() * camera_from_world);
    }
    return out;
}

std::optional<Vec3> seen_at(const std::vector<Camera>& cameras, const FloorPoint& point) {
    std::vector<Observation> observations;
    for (const auto& [camera, pixel] : point.clicks) observations.push_back({&cameras[camera], pixel});
    return triangulate(observations);
}

// Known distances against triangulated ones.
void check_distances(const std::vector<Camera>& cameras, const std::vector<FloorPoint>& points,
                     FloorResult& result) {
    double known = 0, measured = 0;
    for (std::size_t a = 0; a < points.size(); ++a)
        for (std::size_t b = a + 1; b < points.size(); ++b) {
            const auto p = seen_at(cameras, points[a]), q = seen_at(cameras, points[b]);
            if (!p || !q) continue;
            known += norm(*points[a].in_world - *points[b].in_world);
            measured += norm(*p - *q);
        }
    if (known < 0.3) return;
    const double error_fraction = measured / known - 1;
    if (std::abs(error_fraction) < kGoodScale) return;
    result.findings.push_back(
        {std::abs(error_fraction) > kBadScale ? Verdict::kNoGo : Verdict::kCaution, "scale", "",
         fmt::format("the distances between the given points are measured {:.1f} % too {}, "
                     "as from a wrong square size or wand length",
                     100 * std::abs(error_fraction), error_fraction > 0 ? "long" : "short"),
         "measure the points again; if they are right, measure the board's squares or "
         "the wand with a ruler and calibrate again"});
}

// Candidates for the world frame: from points that two cameras see, and from each camera alone.
std::vector<Rigid3> world_candidates(const std::vector<Camera>& cameras,
                                     const std::vector<FloorPoint>& points, const std::vector<Vec3>& in_world,
                                     const std::vector<BundleObservation>& observations) {
    std::vector<Rigid3> candidates;
    std::vector<Vec3> from, to;
    for (const FloorPoint& point : points)
        if (const auto seen = seen_at(cameras, point)) from.push_back(*point.in_world), to.push_back(*seen);
    if (from.size() >= 3 && triangle_height(from) >= kMinTriangle_m)
        if (const auto aligned = align_points(from, to, false))
            candidates.push_back(aligned->target_from_source);
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        std::vector<Vec3> known;
        std::vector<Vec2> seen;
        for (const BundleObservation& o : observations)
            if (o.camera == static_cast<int>(c)) known.push_back(in_world[o.point]), seen.push_back(o.pixel);
        for (const Rigid3& candidate : candidates_of(cameras[c], known, seen))
            candidates.push_back(candidate);
    }
    return candidates;
}

absl::StatusOr<FloorResult> from_known(const std::vector<Camera>& cameras,
                                       const std::vector<FloorPoint>& points) {
    std::vector<Vec3> in_world;
    std::vector<BundleObservation> observations;
    for (const FloorPoint& point : points) {
        for (const auto& [camera, pixel] : point.clicks)
            observations.push_back({camera, 0, static_cast<int>(in_world.size()), pixel, {}, {}});
        in_world.push_back(*point.in_world);
    }
    if (triangle_height(in_world) < kMinTriangle_m)
        return absl::InvalidArgumentError("the given points are collinear; give three or more that are not");
    const std::vector<Rigid3> candidates = world_candidates(cameras, points, in_world, observations);
    if (candidates.empty())
        return absl::FailedPreconditionError(
            "the clicks do not determine the world frame; click three points in one camera, or each of them "
            "in two");
    std::vector<Fit> fits;
    for (const Rigid3& candidate : candidates)
        if (auto fit = fitted(cameras, in_world, observations, candidate)) fits.push_back(*std::move(fit));
    if (fits.empty())
        return absl::FailedPreconditionError(
            "no world frame fits the clicks; check that each point's coordinates are in metres and belong to "
            "its clicks");
    const auto better = [&](const Fit& a, const Fit& b) {
        // Three points in one camera fit several world frames exactly: prefer cameras above the floor.
        if (std::abs(a.rms_px - b.rms_px) > 0.5) return a.rms_px < b.rms_px;
        const int up_a = above_floor(cameras, a.old_from_world.inverse()),
                  up_b = above_floor(cameras, b.old_from_world.inverse());
        return up_a != up_b ? up_a > up_b : a.rms_px < b.rms_px;
    };
    const Fit& best = *std::min_element(fits.begin(), fits.end(), better);
    FloorResult result;
    result.method = "points";
    result.world_from_old = best.old_from_world.inverse();
    result.rms_px = best.rms_px;
    result.on_floor = in_world;
    std::erase_if(result.on_floor, [](Vec3 p) { return std::abs(p.z) > 1e-9; });
    for (const Fit& other : fits)
        if (other.rms_px < best.rms_px + 0.5 &&
            angle_between(other.old_from_world.rotation, best.old_from_world.rotation) > radians(2) &&
            above_floor(cameras, other.old_from_world.inverse()) ==
                above_floor(cameras, result.world_from_old)) {
            result.findings.push_back(
                {Verdict::kCaution, "ambiguous_floor", "",
                 "two world frames fit these clicks equally well; the floor may be the wrong one",
                 "click the points in a second camera too, or a fourth point"});
            break;
        }
    if (best.rms_px > kGoodClick_px) {
        const auto worst =
            std::max_element(best.errors_px.begin(), best.errors_px.end()) - best.errors_px.begin();
        const Vec3 p = in_world[observations[worst].point];
        result.findings.push_back(
            {best.rms_px > kBadClick_px ? Verdict::kNoGo : Verdict::kCaution, "clicked_points",
             cameras[observations[worst].camera].name,
             fmt::format("the reprojection error of the clicks is {:.1f} px, largest ({:.1f} px) in camera "
                         "{} at ({:g}, {:g}, {:g}) m",
                         best.rms_px, best.errors_px[worst], cameras[observations[worst].camera].name, p.x,
                         p.y, p.z),
             "correct that click or those coordinates; if all are right, calibrate the cameras again"});
    }
    check_distances(cameras, points, result);
    return result;
}

absl::StatusOr<FloorResult> from_unknown(const std::vector<Camera>& cameras,
                                         const std::vector<FloorPoint>& points) {
    std::vector<Vec3> in_old;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const auto seen = seen_at(cameras, points[i]);
        if (!seen)
            return absl::FailedPreconditionError(fmt::format(
                "point {}: without world coordinates it must be clicked in two cameras that see it from "
                "different sides; click it in another one",
                i + 1));
        in_old.push_back(*seen);
    }
    if (triangle_height(in_old) < kMinTriangle_m)
        return absl::InvalidArgumentError(
            "the clicked points are collinear; give three or more that are not");
    Eigen::Matrix3Xd p(3, in_old.size());
    for (std::size_t i = 0; i < in_old.size(); ++i) p.col(i) << in_old[i].x, in_old[i].y, in_old[i].z;
    const Eigen::Vector3d mean = p.rowwise().mean();
    const Eigen::JacobiSVD<Eigen::Matrix3Xd> svd(p.colwise() - mean, Eigen::ComputeFullU);
    const Eigen::Vector3d normal = svd.matrixU().col(2);
    Vec3 z{normal.x(), normal.y(), normal.z()};
    const Vec3 middle{mean.x(), mean.y(), mean.z()};
    int above = 0;
    for (const Camera& camera : cameras) above += dot(z, camera.centre_in_world() - middle) > 0 ? 1 : -1;
    if (above < 0) z = -z;
    const Vec3 along = in_old[1] - in_old[0];
    if (norm(along - dot(along, z) * z) < 0.02)
        return absl::InvalidArgumentError(
            "the first two points coincide; the second one gives the x direction");
    const Vec3 x = normalized(along - dot(along, z) * z), y = cross(z, x);
    const Vec3 origin = in_old[0] - dot(in_old[0] - middle, z) * z;
    const Mat3 rotation{{x.x, x.y, x.z, y.x, y.y, y.z, z.x, z.y, z.z}};
    FloorResult result;
    result.method = "points";
    result.world_from_old = {rotation, -(rotation * origin)};
    double squares = 0;
    for (const Vec3 q : in_old) {
        const double off = dot(q - middle, z);
        squares += off * off;
        result.on_floor.push_back(result.world_from_old * q);
    }
    if (in_old.size() > 3) {
        result.flatness_rms_mm = 1000 * std::sqrt(squares / static_cast<double>(in_old.size() - 3));
        if (*result.flatness_rms_mm > kFlat_mm)
            result.findings.push_back(
                {*result.flatness_rms_mm > 4 * kFlat_mm ? Verdict::kNoGo : Verdict::kCaution,
                 "floor_flatness", "",
                 fmt::format("the clicked points deviate by {:.0f} mm from a common plane",
                             *result.flatness_rms_mm),
                 "click the points again, on the floor itself; check the calibration with a person"});
    }
    return result;
}

}  // namespace

absl::StatusOr<FloorResult> floor_from_board(const std::vector<Camera>& cameras,
                                             const std::vector<Vec3>& board_points,
                                             const std::vector<std::vector<Corner>>& seen,
                                             double thickness_m) {
    std::vector<BundleObservation> observations;
    std::vector<PosedView> candidates;
    for (std::size_t c = 0; c < cameras.size() && c < seen.size(); ++c) {
        if (seen[c].empty()) continue;
        for (const Corner& corner : seen[c])
            observations.push_back({static_cast<int>(c), 0, corner.id, corner.pixel, {}, {}});
        if (const auto pose = board_pose(cameras[c], seen[c], board_points))
            candidates.push_back({static_cast<int>(c), seen[c], *pose});
    }
    if (candidates.empty())
        return absl::FailedPreconditionError(
            "no camera detected enough of the board; lay it where two or more see all of it, print up");
    const auto fit =
        fitted(cameras, board_points, observations, best_world_from_board(cameras, candidates, board_points));
    if (!fit) return absl::FailedPreconditionError("no pose fits the board; calibrate the extrinsics first");
    FloorResult result;
    result.method = "board";
    result.world_from_old = Rigid3{{}, {0, 0, thickness_m}} * fit->old_from_world.inverse();
    result.rms_px = fit->rms_px;
    for (const Vec3 p : board_points) result.on_floor.push_back(p);
    if (fit->rms_px > kGoodClick_px)
        result.findings.push_back(
            {fit->rms_px > kBadClick_px ? Verdict::kNoGo : Verdict::kCaution, "board_on_floor", "",
             fmt::format("the cameras are inconsistent about the board on the floor by {:.1f} px",
                         fit->rms_px),
             "keep it still in all images; if it was, a camera has moved: calibrate the extrinsics again"});
    if (candidates.size() == 1)
        result.findings.push_back(
            {Verdict::kCaution, "single_view", cameras[candidates.front().camera].name,
             fmt::format("only camera {} detected the board on the floor",
                         cameras[candidates.front().camera].name),
             "lay it where two or more cameras see it, or check the feet of a person: kinevox calibrate "
             "check"});
    return result;
}

absl::StatusOr<FloorResult> floor_from_points(const std::vector<Camera>& cameras,
                                              const std::vector<FloorPoint>& points) {
    if (points.size() < 3)
        return absl::InvalidArgumentError(
            fmt::format("{} points do not define a floor; give three or four", points.size()));
    const auto known = std::count_if(points.begin(), points.end(),
                                     [](const FloorPoint& p) { return p.in_world.has_value(); });
    if (known == 0) return from_unknown(cameras, points);
    if (known < static_cast<std::ptrdiff_t>(points.size()))
        return absl::InvalidArgumentError("give world coordinates with all points or with none of them");
    return from_known(cameras, points);
}

}  // namespace kinevox
