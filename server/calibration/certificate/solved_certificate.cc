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

// A refinement counts only if silhouettes that it did not use confirm it.
constexpr double kMinHullIou = 0.9;  // after it; below, the silhouettes are the cause, not the cameras
constexpr double kMaxResidualFraction = 0.8;  // of the residual before
constexpr double kMaxCameraLoss = 0.01;       // hull IoU of a camera
// Of two results with about the same residual, the one nearer to the given poses is taken.
constexpr double kSameResidualFraction = 0.99;
// Between both halves: of the correction, and of the size of a pixel amid the cameras (6 mm of usual rigs).
constexpr double kMaxHalvesFraction = 0.5, kMaxHalves_px = 1;
constexpr double kMaxGoMove_m = 0.02;  // beyond it the result needs another confirmation

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

namespace {

SilhouetteSet every_second(const SilhouetteSet& set, std::size_t first) {
    SilhouetteSet out;
    for (std::size_t m = first; m < set.frame_sets.size(); m += 2)
        out.frame_sets.push_back(set.frame_sets[m]);
    return out;
}

struct Candidate {
    SilhouetteRefineOptions options;
    SilhouetteRefineResult refined;
    // Of held-out frame sets.
    HullIou hull;
    double residual_px = 0;
};

// Whether the held-out half of the frame sets asks for the same correction of each camera.
absl::StatusOr<bool> halves_consistent(const std::vector<Camera>& cameras, const SilhouetteSet& held_out,
                                       const Candidate& candidate, const SolveProgress& progress) {
    const auto other = refine_from_silhouettes(cameras, held_out, candidate.options, progress);
    if (absl::IsCancelled(other.status())) return other.status();
    if (!other.ok()) return false;
    Vec3 middle;
    for (const Camera& camera : cameras)
        middle += camera.centre_in_world() / static_cast<double>(cameras.size());
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        const double pixel_m =
            2 * norm(cameras[c].centre_in_world() - middle) / (cameras[c].fx + cameras[c].fy);
        const double apart =
            norm(candidate.refined.cameras[c].centre_in_world() - other->cameras[c].centre_in_world());
        if (apart > std::max(kMaxHalves_px * pixel_m, kMaxHalvesFraction * candidate.refined.moved_m[c]))
            return false;
    }
    return true;
}

bool held_out_confirms(const std::vector<Camera>& cameras, const SilhouetteSet& held_out,
                       const HullIou& before, const Candidate& candidate) {
    if (!(candidate.hull.mean_iou >= kMinHullIou) || !(candidate.hull.mean_iou > before.mean_iou))
        return false;
    for (std::size_t c = 0; c < cameras.size(); ++c)
        if (candidate.hull.iou[c] < before.iou[c] - kMaxCameraLoss) return false;
    return candidate.residual_px < kMaxResidualFraction * silhouette_residual_px(cameras, held_out);
}

void report_refusal(const HullIou& before, const HullIou& best, std::vector<Finding>& findings) {
    if (std::max(before.mean_iou, best.mean_iou) < kMinHullIou)
        findings.push_back(
            {Verdict::kCaution, "poor_silhouettes", "",
             fmt::format("the silhouettes are too poor to correct cameras: whatever the extrinsics, "
                         "the hull IoU stays below {:.2f} ({:.2f} as given); nothing was changed",
                         std::max(kMinHullIou, best.mean_iou), before.mean_iou),
             "record a person in clothes that differ from the background, and check the "
             "silhouettes (kinevox process --save silhouettes)"});
    else
        findings.push_back({Verdict::kCaution, "no_improvement", "",
                            "held-out silhouettes confirm no other extrinsics: nothing was changed",
                            "for a better result, record a person who walks through the whole space"});
}

}  // namespace

absl::StatusOr<PersonRefinement> refine_from_person(const std::vector<Camera>& cameras,
                                                    const SilhouetteSet& silhouettes, int frame_sets,
                                                    std::optional<double> height_m,
                                                    const SolveProgress& progress) {
    PersonRefinement out;
    Certificate& certificate = out.certificate;
    certificate.method = "person";
    certificate.cameras = cameras;
    const SilhouetteSet fitted = every_second(silhouettes, 0), held_out = every_second(silhouettes, 1);
    const HullIou before = hull_iou(cameras, held_out);
    certificate.hull_iou_before = certificate.hull_iou = before;
    // The error of the given poses is unknown: of the priors, the narrowest that explains the silhouettes.
    std::optional<Candidate> best;
    for (const auto& [angle_deg, shift_m] :
         {std::pair{0.25, 0.02}, std::pair{1.0, 0.07}, std::pair{5.0, 0.35}}) {
        Candidate one;
        one.options.max_frame_sets = frame_sets;
        one.options.prior_angle_deg = angle_deg, one.options.prior_shift_m = shift_m;
        auto refined = refine_from_silhouettes(cameras, fitted, one.options, progress);
        if (!refined.ok()) return refined.status();
        one.refined = *std::move(refined);
        one.hull = hull_iou(one.refined.cameras, held_out);
        one.residual_px = silhouette_residual_px(one.refined.cameras, held_out);
        // The residual shows fractions of a degree that hardly change the hull.
        if (!best || one.residual_px < kSameResidualFraction * best->residual_px) best = std::move(one);
    }
    bool confirmed = held_out_confirms(cameras, held_out, before, *best);
    if (confirmed) {
        const auto consistent = halves_consistent(cameras, held_out, *best, progress);
        if (!consistent.ok()) return consistent.status();
        confirmed = *consistent;
    }
    if (confirmed) {
        // Once confirmed, all frame sets determine the correction; hull IoU and residual stay those of the
        // half that did not use them.
        auto refined = refine_from_silhouettes(cameras, silhouettes, best->options, progress);
        if (!refined.ok()) return refined.status();
        best->refined = *std::move(refined);
        certificate.hull_iou = best->hull;
        certificate.cameras = best->refined.cameras;
        const double moved_m = *std::ranges::max_element(best->refined.moved_m);
        if (moved_m > kMaxGoMove_m)
            certificate.findings.push_back(
                {Verdict::kCaution, "cameras_corrected", "",
                 fmt::format("cameras were moved by up to {:.0f} mm, confirmed by silhouettes only",
                             1000 * moved_m),
                 "confirm with a board or wand, or calibrate the extrinsics again"});
        out.better = std::move(best->refined);
    } else {
        report_refusal(before, best->hull, certificate.findings);
    }
    check_with_person(silhouettes, height_m, certificate);
    return out;
}

}  // namespace kinevox
