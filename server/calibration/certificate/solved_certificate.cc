#include "server/calibration/certificate/solved_certificate.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>

#include "server/calibration/multi_view.h"
#include "server/calibration/person/diagnosis.h"
#include "server/calibration/person/silhouette_hull.h"

namespace kinevox {
namespace {

constexpr double kSamePosition_m = 0.05;   // repeatability of an untouched camera's position
constexpr double kMovedPosition_m = 0.30;  // beyond it they do not determine the previous floor

void move_world(const SimilarityTransform& new_from_old, ExtrinsicsResult& result) {
    move_cameras(new_from_old, result.cameras);
    for (Vec3& point : result.target_points) point = new_from_old(point);
}

// The mean over adjacent frame sets in which the board rests, within the measurement error.
Rigid3 resting_pose(const std::map<int, Rigid3>& poses, std::map<int, Rigid3>::const_iterator lying) {
    constexpr double kStill_m = 0.01, kStillRotation = 0.02;  // rad
    const auto rests = [&](const Rigid3& pose) {
        return norm(pose.translation - lying->second.translation) < kStill_m &&
               angle_between(pose.rotation, lying->second.rotation) < kStillRotation;
    };
    auto first = lying, end = std::next(lying);
    while (first != poses.begin() && rests(std::prev(first)->second)) --first;
    while (end != poses.end() && rests(end->second)) ++end;
    Vec3 shift, rotation;  // against `lying`, both small
    const double fraction = 1.0 / static_cast<double>(std::distance(first, end));
    for (auto pose = first; pose != end; ++pose) {
        const Rigid3 difference = lying->second.inverse() * pose->second;
        shift += fraction * difference.translation;
        rotation += fraction * rodrigues_from_rotation(difference.rotation);
    }
    return lying->second * Rigid3{rotation_from_rodrigues(rotation), shift};
}

}  // namespace

absl::Status define_world_by_board(std::span<const int> lying, ExtrinsicsResult& result) {
    for (const int frame_set : lying) {
        const auto found = result.world_from_board.find(frame_set);
        if (found == result.world_from_board.end()) continue;
        move_world({1, resting_pose(result.world_from_board, found).inverse()}, result);
        return absl::OkStatus();
    }
    return absl::FailedPreconditionError(
        "no two cameras detected the board on the floor; put it where two or more see all of it");
}

bool inherit_world(const std::vector<Camera>& like, ExtrinsicsResult& result) {
    std::vector<Vec3> from, to;
    for (const Camera& camera : result.cameras)
        if (const Camera* const there = camera_named(like, camera.name)) {
            from.push_back(camera.centre_in_world());
            to.push_back(there->centre_in_world());
        }
    const auto like_from_solved = from.size() < 3 ? std::nullopt : align_points(from, to, false);
    if (!like_from_solved) return false;
    double farthest = 0;
    for (std::size_t i = 0; i < from.size(); ++i)
        farthest = std::max(farthest, norm((*like_from_solved)(from[i]) - to[i]));
    if (farthest > kMovedPosition_m) return false;
    move_world(*like_from_solved, result);
    const bool same = farthest <= kSamePosition_m;
    result.findings.push_back({same ? Verdict::kGo : Verdict::kCaution, "world_inherited", "",
                               fmt::format("floor and origin are inherited from the active calibration; the "
                                           "cameras are up to {:.0f} mm from "
                                           "their positions there",
                                           1000 * farthest),
                               same ? "" : "show the board on the floor to define the world frame again"});
    return true;
}

Certificate intrinsics_certificate(std::vector<IntrinsicsResult> results) {
    Certificate certificate;
    certificate.method = "intrinsics_board";
    for (const IntrinsicsResult& result : results) {
        certificate.cameras.push_back(result.camera);
        certificate.findings.insert(certificate.findings.end(), result.findings.begin(),
                                    result.findings.end());
    }
    certificate.intrinsics = std::move(results);
    return certificate;
}

Certificate extrinsics_certificate(const std::string& method, ExtrinsicsResult result, bool world_defined) {
    Certificate certificate;
    certificate.method = method;
    certificate.world_defined = world_defined;
    if (world_defined) certificate.findings = check_world(result.cameras, std::nullopt, std::nullopt);
    certificate.volume = volume_coverage(result.cameras, result.target_points, {}, {});
    certificate.target_points = sample_points(result.target_points);
    certificate.cameras = std::move(result.cameras);
    certificate.reprojections = std::move(result.reprojections);
    certificate.fit_rms_px = result.fit_rms_px;
    certificate.held_out_rms_px = result.held_out_rms_px;
    certificate.scale = result.scale;
    certificate.findings.insert(certificate.findings.end(), result.findings.begin(), result.findings.end());
    return certificate;
}

void check_with_person(const SilhouetteSet& silhouettes, std::optional<double> height_m,
                       Certificate& certificate) {
    const std::vector<Camera>& cameras = certificate.cameras;
    const auto extent = subject_extent(cameras, silhouettes);
    if (extent) certificate.stature_m = extent->highest_m - extent->lowest_m;
    certificate.world_defined = true;
    certificate.overlays = silhouette_overlays(cameras, silhouettes);
    for (Finding& finding : check_world(cameras, extent, height_m))
        certificate.findings.push_back(std::move(finding));
}

absl::StatusOr<PersonRefinement> refine_from_person(const std::vector<Camera>& cameras,
                                                    const SilhouetteSet& silhouettes, int frame_sets,
                                                    std::optional<double> height_m,
                                                    const SolveProgress& progress) {
    PersonRefinement out;
    Certificate& certificate = out.certificate;
    certificate.method = "person";
    certificate.cameras = cameras;
    // Measured on held-out frame sets.
    SilhouetteSet fitted, kept_out;
    for (std::size_t m = 0; m < silhouettes.frame_sets.size(); ++m)
        (m % 2 ? kept_out : fitted).frame_sets.push_back(silhouettes.frame_sets[m]);
    certificate.hull_iou_before = certificate.hull_iou = hull_iou(cameras, kept_out);
    // The error of the given poses is unknown: the prior with the largest hull IoU wins.
    for (const auto& [angle_deg, shift_m] :
         {std::pair{0.25, 0.02}, std::pair{1.0, 0.07}, std::pair{5.0, 0.35}}) {
        SilhouetteRefineOptions options;
        options.max_frame_sets = frame_sets;
        options.prior_angle_deg = angle_deg, options.prior_shift_m = shift_m;
        auto refined = refine_from_silhouettes(cameras, fitted, options, progress);
        if (!refined.ok()) return refined.status();
        const HullIou hull = hull_iou(refined->cameras, kept_out);
        if (!(hull.mean_iou > certificate.hull_iou->mean_iou)) continue;
        certificate.hull_iou = hull;
        certificate.cameras = refined->cameras;
        out.better = *std::move(refined);
    }
    if (!out.better)
        certificate.findings.push_back(
            {Verdict::kCaution, "no_improvement", "",
             "no other extrinsics fit the silhouettes better: nothing was changed",
             "for a better result, record a person who walks through the whole space"});
    check_with_person(silhouettes, height_m, certificate);
    return out;
}

}  // namespace kinevox
