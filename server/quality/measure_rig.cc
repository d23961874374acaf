// Consistency of cameras and silhouettes, and of the world frame with gravity and the floor.
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/calibration/person/silhouette_hull.h"
#include "server/calibration/person/silhouette_refine.h"
#include "server/quality/judges.h"
#include "server/quality/samples.h"

namespace kinevox::quality {
namespace {

constexpr double kDegreesPerRadian = 180 / std::numbers::pi;
constexpr Vec3 kUp{0, 0, 1};
constexpr std::size_t kHypothesisFrameSets = 6;
constexpr int kHypothesisPoints = 24;  // per silhouette: enough to compare hypotheses
// Few cameras that roll differently have a common direction, too: a subject who is upright decides.
constexpr std::size_t kFewCameras = 3;
constexpr double kMaxRollRms = 6;  // degrees: cameras that are mounted without common horizon

SilhouetteSet some_of(const SilhouetteSet& set, std::size_t max) {
    SilhouetteSet some;
    const std::size_t count = std::min(max, set.frame_sets.size());
    for (std::size_t n = 0; n < count; ++n)
        some.frame_sets.push_back(set.frame_sets[n * set.frame_sets.size() / count]);
    return some;
}

double residual_of(const std::vector<Camera>& cameras, const SilhouetteSet& set) {
    SilhouetteRefineOptions options;
    options.contour_points = kHypothesisPoints;
    return silhouette_residual_px(cameras, set, options);
}

void keep_better(std::optional<RigHypothesis>& best, const RigHypothesis& one) {
    if (!best || one.residual_px < best->residual_px) best = one;
}

Camera with_focal_factor(Camera camera, double factor, bool resized) {
    camera.fx *= factor, camera.fy *= factor;
    if (resized) {
        camera.cx = (camera.cx + 0.5) * factor - 0.5;
        camera.cy = (camera.cy + 0.5) * factor - 0.5;
    }
    return camera;
}

void test_swaps(const std::vector<Camera>& cameras, const SilhouetteSet& some, RigMeasurements& out) {
    for (std::size_t a = 0; a < cameras.size(); ++a)
        for (std::size_t b = a + 1; b < cameras.size(); ++b) {
            if (cameras[a].width != cameras[b].width || cameras[a].height != cameras[b].height) continue;
            SilhouetteSet swapped = some;
            for (auto& images : swapped.frame_sets) std::swap(images[a], images[b]);
            keep_better(out.swapped, {.camera = a, .residual_px = residual_of(cameras, swapped), .other = b});
        }
}

void test_moves(const std::vector<Camera>& cameras, const SilhouetteSet& some, RigMeasurements& out) {
    for (std::size_t c = 0; cameras.size() > 2 && c < cameras.size(); ++c) {
        SilhouetteRefineOptions one;
        one.fixed.assign(cameras.size(), true);
        one.fixed[c] = false;
        one.rounds = 20;
        one.contour_points = kHypothesisPoints;
        one.prior_angle_deg = 4, one.prior_shift_m = 0.3;  // wide: its error is unknown
        const auto refined = refine_from_silhouettes(cameras, some, one);
        if (!refined.ok()) continue;
        keep_better(out.moved, {.camera = c,
                                .residual_px = refined->residual_after_px,
                                .rotated_deg = refined->rotated_deg[c],
                                .moved_m = refined->moved_m[c]});
    }
}

void test_intrinsics(const std::vector<Camera>& cameras, const SilhouetteSet& some, RigMeasurements& out) {
    static constexpr double kFactors[] = {0.5, 0.667, 0.8, 0.87, 0.93, 1.07, 1.15, 1.25, 1.5, 2.0};
    for (const double factor : kFactors) {
        for (const bool resized : {false, true}) {
            std::vector<Camera> all;
            for (const Camera& camera : cameras) all.push_back(with_focal_factor(camera, factor, resized));
            keep_better(out.all_intrinsics, {.residual_px = residual_of(all, some), .focal_factor = factor});
        }
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            std::vector<Camera> one = cameras;
            one[c] = with_focal_factor(cameras[c], factor, false);
            keep_better(out.intrinsics,
                        {.camera = c, .residual_px = residual_of(one, some), .focal_factor = factor});
        }
    }
}

// The up direction from the horizontal rows of all images, or their columns where the camera is mounted on
// its side; sign from the columns of the upright ones.
std::optional<Vec3> up_from_cameras(const std::vector<Camera>& cameras) {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    Eigen::Vector3d up = Eigen::Vector3d::Zero();
    for (const Camera& camera : cameras) {
        const Mat3& r = camera.camera_from_world.rotation;
        const Eigen::Vector3d row(r(0, 0), r(0, 1), r(0, 2)), column(r(1, 0), r(1, 1), r(1, 2));
        const bool upright = std::abs(row.z()) <= std::abs(column.z());
        const Eigen::Vector3d& level = upright ? row : column;
        sum += level * level.transpose();
        if (upright) up -= column;
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(sum / static_cast<double>(cameras.size()));
    const auto values = solver.eigenvalues();
    constexpr double kMinSpread = 0.02;  // cameras side by side leave the direction open
    if (values(1) < kMinSpread) return std::nullopt;
    if (std::asin(std::sqrt(std::clamp(values(0), 0.0, 1.0))) * kDegreesPerRadian > kMaxRollRms)
        return std::nullopt;
    Eigen::Vector3d axis = solver.eigenvectors().col(0);
    if (up.norm() > 0 ? axis.dot(up) < 0 : axis.z() < 0) axis = -axis;
    return Vec3{axis.x(), axis.y(), axis.z()};
}

// Of the subject in each frame set that shows all of it.
struct SubjectExtents {
    std::vector<double> lowest_m, heights_m, leans_deg;
    Vec3 upwards;  // from the feet to the centre, sum of directions
};

SubjectExtents extents_along(Vec3 up, const std::vector<Camera>& cameras, const SilhouetteSet& subject) {
    SubjectExtents out;
    for (const auto& images : subject.frame_sets) {
        if (std::ranges::any_of(images, &SilhouetteMask::truncated)) continue;
        const SilhouetteHull hull(cameras, images);
        if (!hull.usable()) continue;
        const auto extent = hull.extent(up);
        if (!extent) continue;
        out.lowest_m.push_back(extent->lowest.z);
        out.heights_m.push_back(norm(extent->highest - extent->lowest));
        const Vec3 axis = hull.middle() - extent->lowest;
        const Vec3 direction = axis / std::max(norm(axis), 1e-6);
        out.upwards += direction;
        out.leans_deg.push_back(std::acos(std::clamp(direction.z, -1.0, 1.0)) * kDegreesPerRadian);
    }
    return out;
}

}  // namespace

RigMeasurements measure_rig(const Samples& seen, const SilhouetteSet& subject,
                            std::vector<CameraMeasurements>& out) {
    RigMeasurements rig;
    rig.side_px = max_side_px(seen.cameras);
    HullIouOptions options;
    options.max_frame_sets = 24;
    options.pixels = 800;
    const HullIou hull = hull_iou(seen.cameras, subject, options);
    if (hull.frames > 0 && std::isfinite(hull.mean_iou)) rig.hull_iou = hull.mean_iou;
    for (std::size_t c = 0; c < out.size() && c < hull.iou.size(); ++c)
        if (std::isfinite(hull.iou[c])) {
            out[c].hull_iou = hull.iou[c];
            rig.min_hull_iou = std::min(rig.min_hull_iou.value_or(1), hull.iou[c]);
        }
    if (hull.frames > 0) rig.low_hull_iou = quantile_or(hull.frame_set_min_iou, 0.1, 1);
    const double residual = residual_of(seen.cameras, subject);
    if (!std::isfinite(residual)) return rig;
    rig.residual_px = residual;
    if (!rig_is_inconsistent(rig)) return rig;
    const SilhouetteSet some = some_of(subject, kHypothesisFrameSets);
    test_swaps(seen.cameras, some, rig);
    test_moves(seen.cameras, some, rig);
    test_intrinsics(seen.cameras, some, rig);
    return rig;
}

WorldMeasurements measure_world(const Samples& seen, const SilhouetteSet& subject) {
    WorldMeasurements out;
    for (const Camera& camera : seen.cameras)
        out.cameras_below_fraction +=
            (camera.centre_in_world().z < 0 ? 1.0 : 0.0) / static_cast<double>(seen.cameras.size());
    std::optional<Vec3> up = up_from_cameras(seen.cameras);
    SubjectExtents extents = extents_along(up.value_or(kUp), seen.cameras, subject);
    if (up && seen.cameras.size() <= kFewCameras && dot(extents.upwards, *up) < dot(extents.upwards, kUp)) {
        up.reset();
        extents = extents_along(kUp, seen.cameras, subject);
    }
    if (up) out.tilt_deg = std::acos(std::clamp(up->z, -1.0, 1.0)) * kDegreesPerRadian;
    constexpr std::size_t kMinFrameSets = 5;
    if (extents.lowest_m.size() < kMinFrameSets) return out;
    out.lowest_m = quantile_or(extents.lowest_m, 0.5, 0);
    out.subject_tilt_deg = quantile_or(extents.leans_deg, 0.5, 0);
    out.subject_height_m = quantile_or(extents.heights_m, 0.5, 0);
    out.max_height_m = quantile_or(extents.heights_m, 0.9, 0);
    return out;
}

}  // namespace kinevox::quality
