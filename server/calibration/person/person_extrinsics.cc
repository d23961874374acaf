#include "server/calibration/person/person_extrinsics.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/calib3d.hpp>

#include "common/median.h"
#include "server/calibration/bundle.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/opencv_helpers.h"
#include "server/calibration/person/person_world.h"
#include "server/calibration/person/silhouette_refine.h"

namespace kinevox {
namespace {

// Body landmarks that silhouettes show similarly from every side: correspondences between cameras with
// unknown poses. Top of the head (or of a raised arm), centroid of the silhouette's upper third, and its
// centroid. Each is within a few centimetres of one body point from any side.
constexpr int kPersonLandmarks = 3;
using PersonLandmarks = std::array<Vec2, kPersonLandmarks>;                  // px
using Landmarks = std::vector<std::vector<std::optional<PersonLandmarks>>>;  // [frame set][camera]

// Direction of the body's axis in a camera's image, over all frame sets; the camera is rolled by less than 60
// degrees.
Vec2 image_up(const Camera& camera, const SilhouetteSet& silhouettes, std::size_t c) {
    double cosine = 0, sine = 0;  // of twice the axis' angle: an axis has no sign
    for (const auto& images : silhouettes.frame_sets) {
        if (images[c].empty() || images[c].truncated) continue;
        double n = 0, sx = 0, sy = 0, sxx = 0, syy = 0, sxy = 0;
        for (int y = 0; y < camera.height; y += 2)
            for (int x = 0; x < camera.width; x += 2) {
                if (!images[c].mask[static_cast<std::size_t>(y) * camera.width + x]) continue;
                n += 1, sx += x, sy += y, sxx += 1.0 * x * x, syy += 1.0 * y * y, sxy += 1.0 * x * y;
            }
        if (n < 1) continue;
        const double cxx = sxx - sx * sx / n, cyy = syy - sy * sy / n, cxy = sxy - sx * sy / n;
        const double size = cxx + cyy;
        if (size > 0)
            cosine += (cxx - cyy) / size, sine += 2 * cxy / size;  // elongated bodies carry more information
    }
    if (cosine == 0 && sine == 0) return {0, -1};
    const double angle = 0.5 * std::atan2(sine, cosine);
    const Vec2 axis{std::cos(angle), std::sin(angle)};
    if (std::abs(axis.y) < 0.5) return {0, -1};  // lying all the time
    return axis.y < 0 ? axis : Vec2{-axis.x, -axis.y};
}

std::optional<PersonLandmarks> landmarks_of(const Camera& camera, const SilhouetteMask& image, Vec2 up) {
    double most = -std::numeric_limits<double>::max(), least = -most, n = 0;
    Vec2 middle, upper, top;
    const auto each = [&](const auto& body) {
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x)
                if (image.mask[static_cast<std::size_t>(y) * camera.width + x])
                    body(x, y, up.x * x + up.y * y);
    };
    each([&](int x, int y, double along) {
        most = std::max(most, along), least = std::min(least, along);
        middle.x += x, middle.y += y, n += 1;
    });
    if (n < 50) return std::nullopt;
    const double third = most - (most - least) / 3, tip = most - std::max(1.5, 0.01 * (most - least));
    double in_third = 0, in_tip = 0;
    each([&](int x, int y, double along) {
        if (along >= third) upper.x += x, upper.y += y, in_third += 1;
        if (along >= tip) top.x += x, top.y += y, in_tip += 1;
    });
    return PersonLandmarks{Vec2{top.x / in_tip, top.y / in_tip}, Vec2{upper.x / in_third, upper.y / in_third},
                           Vec2{middle.x / n, middle.y / n}};
}

// Empty without a silhouette or if the image border truncates it. Cameras may be rolled by up to 60
// degrees: up in the image is the body's axis over all frame sets.
Landmarks person_landmarks(const std::vector<Camera>& intrinsics, const SilhouetteSet& silhouettes) {
    Landmarks out(silhouettes.frame_sets.size(),
                  std::vector<std::optional<PersonLandmarks>>(intrinsics.size()));
    oneapi::tbb::parallel_for(std::size_t{0}, intrinsics.size(), [&](std::size_t c) {
        const Vec2 up = image_up(intrinsics[c], silhouettes, c);
        for (std::size_t m = 0; m < out.size(); ++m)
            if (const SilhouetteMask& image = silhouettes.frame_sets[m][c];
                !image.empty() && !image.truncated)
                out[m][c] = landmarks_of(intrinsics[c], image, up);
    });
    return out;
}

constexpr std::size_t kMinShared = 12;         // shared frame sets
constexpr double kTopToCentreFraction = 0.42;  // of a person's height, from the top of the head to the centre
constexpr int kTries = 3;                      // of the initial poses, with different random samples
constexpr double kSureResidualFraction =
    0.001;  // of the image's longer side: initial poses with a smaller residual need no retry
constexpr double kGoodResidualFraction = 0.002;      // larger ones are not reliable
constexpr double kStayed_m = 0.5, kWayLong_m = 1.5;  // over which the subject should walk
constexpr double kSureCentre_mm = 60,
                 kSureRotation_deg = 1.0;  // between the halves of the session: more is uncertain
constexpr double kUnknownCentre_mm = 300, kUnknownRotation_deg = 5;  // and more is unusable
constexpr double kUnevenHeight = 1.08;  // upper over median height of the hulls: bent, or arms raised

// The upper body's length, in units of the baseline, gives all pairs the same unit.
std::optional<CameraPair> join(const std::vector<Camera>& intrinsics, const Landmarks& landmarks, int a,
                               int b, const PersonExtrinsicsOptions& options, int attempt) {
    std::vector<cv::Point2d> in_a, in_b;
    for (const auto& frame_set : landmarks) {
        if (!frame_set[a] || !frame_set[b]) continue;
        for (int k = 0; k < kPersonLandmarks; ++k) {
            in_a.push_back(normalised_image_point(intrinsics[a], (*frame_set[a])[k]));
            in_b.push_back(normalised_image_point(intrinsics[b], (*frame_set[b])[k]));
        }
    }
    if (in_a.size() < kPersonLandmarks * kMinShared) return std::nullopt;
    cv::setRNGSeed(1 + attempt);
    cv::Mat inside, rotation, shift, points;
    const double side = std::max(intrinsics[a].width, intrinsics[a].height);
    const double threshold = options.landmark_error_fraction * (1 - 0.25 * attempt) * side /
                             std::min(intrinsics[a].fx, intrinsics[b].fx);
    const cv::Mat essential =
        cv::findEssentialMat(in_b, in_a, cv::Mat::eye(3, 3, CV_64F), cv::RANSAC, 0.9999, threshold, inside);
    if (essential.rows != 3) return std::nullopt;
    const int good = cv::recoverPose(essential, in_b, in_a, cv::Mat::eye(3, 3, CV_64F), rotation, shift, 1e3,
                                     inside, points);
    if (good < static_cast<int>(kPersonLandmarks * kMinShared) / 2) return std::nullopt;
    std::vector<double> lengths;
    for (int m = 0; m + kPersonLandmarks <= points.cols; m += kPersonLandmarks) {
        const int last = m + kPersonLandmarks - 1;
        if (!inside.at<std::uint8_t>(m) || !inside.at<std::uint8_t>(last)) continue;
        const auto at = [&](int i) {
            const double w = points.at<double>(3, i);
            return Vec3{points.at<double>(0, i) / w, points.at<double>(1, i) / w,
                        points.at<double>(2, i) / w};
        };
        lengths.push_back(norm(at(m) - at(last)));
    }
    if (lengths.size() < kMinShared / 2) return std::nullopt;
    const double length = median_of(lengths);
    if (!(length > 0)) return std::nullopt;
    CameraPair pair{a, b, {}, good};
    for (int i = 0; i < 9; ++i) pair.a_from_b.rotation.m[i] = rotation.at<double>(i / 3, i % 3);
    pair.a_from_b.translation = (kTopToCentreFraction * options.height_m / length) *
                                Vec3{shift.at<double>(0), shift.at<double>(1), shift.at<double>(2)};
    return pair;
}

// Every landmark of every frame set is a point of its own.
absl::Status adjust(std::vector<Camera>& cameras, const Landmarks& landmarks,
                    const std::vector<int>& camera_of, double robust_px) {
    Bundle bundle;
    bundle.cameras = cameras;
    bundle.points_in_target = {{0, 0, 0}};
    for (const auto& frame_set : landmarks)
        for (int k = 0; k < kPersonLandmarks; ++k) {
            std::vector<Observation> observations;
            std::vector<int> seen;
            for (std::size_t c = 0; c < cameras.size(); ++c)
                if (frame_set[camera_of[c]]) {
                    observations.push_back({&cameras[c], (*frame_set[camera_of[c]])[k]});
                    seen.push_back(static_cast<int>(c));
                }
            const auto point = triangulate(observations);
            if (!point) continue;
            const int target = static_cast<int>(bundle.world_from_target.size());
            bundle.world_from_target.push_back({{}, *point});
            for (std::size_t i = 0; i < seen.size(); ++i)
                bundle.observations.push_back({seen[i], target, 0, observations[i].pixel, {}, {}});
        }
    BundleOptions options;
    options.robust_px = robust_px;
    options.fixed_rotations = true;
    BundleReport report;
    if (absl::Status solved = solve_bundle(bundle, options, report); !solved.ok()) return solved;
    cameras = bundle.cameras;
    return absl::OkStatus();
}

// Replaces earlier findings: the poses may have been refined.
void judge(const PersonWorld& world, double side_px, PersonExtrinsicsResult& result) {
    std::erase_if(result.findings, [](const Finding& f) { return f.check != "unconnected_camera"; });
    const auto add = [&](Verdict verdict, const char* check, std::string reason, const char* remedy) {
        result.findings.push_back({verdict, check, "", std::move(reason), remedy});
    };
    const bool little = world.way_long_m < kWayLong_m;
    // Unknown from a few frame sets: uncertain, but no reason to refuse.
    const double centre_mm = result.uncertainty ? result.uncertainty->centre_mm : kUnknownCentre_mm,
                 rotation_deg = result.uncertainty ? result.uncertainty->rotation_deg : kUnknownRotation_deg;
    const bool unsure = centre_mm > kSureCentre_mm || rotation_deg > kSureRotation_deg,
               unknown = centre_mm > kUnknownCentre_mm || rotation_deg > kUnknownRotation_deg;
    if (result.residual_px > kGoodResidualFraction * side_px)
        add(Verdict::kNoGo, "silhouette_residual",
            fmt::format("silhouettes are inconsistent by {:.1f} px; up to {:.1f} px is good",
                        result.residual_px, kGoodResidualFraction * side_px),
            "check whether the silhouettes are complete and the cameras synchronised, and calibrate again");
    // Both halves then have the same errors and are consistent.
    if (world.way_long_m < kStayed_m)
        add(Verdict::kNoGo, "insufficient_movement",
            fmt::format("the person stayed within {:.1f} m: that leaves the camera positions uncertain by a "
                        "decimetre or more",
                        world.way_long_m),
            "let the person walk through the whole space, ideally in a circle of two metres or more");
    else if (little || unsure)
        add(unknown ? Verdict::kNoGo : Verdict::kCaution, "insufficient_movement",
            fmt::format("the person moved over {:.1f} m by {:.1f} m; {}", world.way_long_m, world.way_wide_m,
                        !result.uncertainty
                            ? "too few frame sets to estimate the uncertainty"
                            : fmt::format("the two halves of the session give camera poses that differ by "
                                          "{:.0f} mm and {:.1f} degrees",
                                          centre_mm, rotation_deg)),
            "let the person walk through the whole space, ideally in a circle of two metres or more");
    if (world.uneven_height > kUnevenHeight)
        add(Verdict::kCaution, "scale",
            fmt::format("the person's height varies by {:.0f} %: bent down or with raised arms, so that the "
                        "scale is uncertain",
                        100 * (world.uneven_height - 1)),
            "let the person walk upright with the arms down");
}

SilhouetteSet of_cameras(const SilhouetteSet& all, const std::vector<int>& camera_of) {
    SilhouetteSet some;
    for (const auto& frame_set : all.frame_sets) {
        std::vector<SilhouetteMask> images;
        for (const int c : camera_of) images.push_back(frame_set[c]);
        some.frame_sets.push_back(std::move(images));
    }
    return some;
}

// Wide enough for poses that are off by ten degrees, then on the contours alone.
SilhouetteRefineOptions refinement(int frame_sets, bool wide) {
    SilhouetteRefineOptions options;
    options.max_frame_sets = frame_sets;
    options.contour_points = wide ? 56 : 24;
    options.rounds = wide ? 30 : 40;
    options.tangent_weight = 3, options.tangent_scale = 0.2;
    // The initial poses carry no information: a weak prior that only prevents drift.
    options.prior_angle_deg = 30, options.prior_shift_m = 5;
    options.first_scale_fraction = wide ? 0.05 : 0.008;
    options.last_scale_fraction = wide ? 0.006 : 0.002;
    return options;
}

// Mean direction from the centroid to the top of the head.
Vec3 body_axis(const std::vector<Camera>& cameras, const Landmarks& landmarks,
               const std::vector<int>& camera_of) {
    Vec3 sum;
    for (const auto& frame_set : landmarks) {
        std::vector<Observation> tops, centres;
        for (std::size_t c = 0; c < cameras.size(); ++c)
            if (const auto& seen = frame_set[camera_of[c]]) {
                tops.push_back({&cameras[c], seen->front()});
                centres.push_back({&cameras[c], seen->back()});
            }
        const auto top = triangulate(tops), middle = triangulate(centres);
        if (top && middle) sum += normalized(*top - *middle);
    }
    return sum;
}

struct CameraPoses {
    std::vector<Camera> cameras;
    std::vector<int> camera_of;  // index among all
    double residual_px = 1e9;
};

absl::StatusOr<CameraPoses> first_poses(const std::vector<Camera>& intrinsics, const Landmarks& landmarks,
                                        const SilhouetteSet& silhouettes,
                                        const PersonExtrinsicsOptions& options, int attempt) {
    std::vector<CameraPair> pairs;
    const int count = static_cast<int>(intrinsics.size());
    for (int a = 0; a < count; ++a)
        for (int b = a + 1; b < count; ++b)
            if (const auto pair = join(intrinsics, landmarks, a, b, options, attempt)) pairs.push_back(*pair);
    if (pairs.empty())
        return absl::FailedPreconditionError(fmt::format(
            "no two cameras see the whole person, from head to feet, in {} or more shared frame sets "
            "at different positions; let a person walk through the whole space for half a minute",
            kMinShared));
    const CameraTree tree = join_cameras(count, pairs);
    CameraPoses poses;
    poses.camera_of = tree.groups.front();
    for (const int c : poses.camera_of) {
        poses.cameras.push_back(intrinsics[c]);
        poses.cameras.back().camera_from_world = tree.camera_from_world[c];
    }
    const double robust_px = 0.25 * options.landmark_error_fraction * max_side_px(intrinsics);
    if (absl::Status adjusted = adjust(poses.cameras, landmarks, poses.camera_of, robust_px); !adjusted.ok())
        return adjusted;
    const SilhouetteSet seen = of_cameras(silhouettes, poses.camera_of);
    auto refined = refine_from_silhouettes(poses.cameras, seen, refinement(options.first_frame_sets, true));
    if (!refined.ok()) return refined.status();
    poses.cameras = refined->cameras;
    poses.residual_px = refined->residual_after_px;
    return poses;
}

}  // namespace

absl::StatusOr<PersonExtrinsicsResult> extrinsics_from_person(const std::vector<Camera>& intrinsics,
                                                              const SilhouetteSet& silhouettes,
                                                              const PersonExtrinsicsOptions& options,
                                                              const SolveProgress& progress) {
    const absl::Status cancelled = absl::CancelledError("stopped; nothing was changed");
    if (progress && !progress(0.02, "silhouette landmarks")) return cancelled;
    const Landmarks landmarks = person_landmarks(intrinsics, silhouettes);
    CameraPoses best;
    for (int attempt = 0; attempt < kTries; ++attempt) {
        if (progress && !progress(0.05 + 0.2 * attempt, "initial camera poses")) return cancelled;
        auto poses = first_poses(intrinsics, landmarks, silhouettes, options, attempt);
        if (!poses.ok()) {
            if (attempt == 0) return poses.status();
            continue;
        }
        const bool more = poses->cameras.size() > best.cameras.size();
        if (more || (poses->cameras.size() == best.cameras.size() && poses->residual_px < best.residual_px))
            best = *std::move(poses);
        if (best.cameras.size() == intrinsics.size() &&
            best.residual_px < kSureResidualFraction * max_side_px(intrinsics))
            break;
    }
    const SilhouetteSet seen = of_cameras(silhouettes, best.camera_of);
    const SolveProgress within = [&](double fraction, const std::string& what) {
        return !progress || progress(0.65 + 0.3 * fraction, what);
    };
    PersonExtrinsicsResult result;
    result.cameras = best.cameras;
    for (std::size_t c = 0; c < intrinsics.size(); ++c)
        if (std::find(best.camera_of.begin(), best.camera_of.end(), static_cast<int>(c)) ==
            best.camera_of.end()) {
            result.excluded_cameras.push_back(intrinsics[c].name);
            result.findings.push_back(
                {Verdict::kNoGo, "unconnected_camera", intrinsics[c].name,
                 fmt::format("camera {} shares too few views of the person with the others",
                             intrinsics[c].name),
                 "let the person walk where it and another camera see them from head to feet"});
        }
    return improve_extrinsics_from_person(std::move(result), seen, options, within);
}

absl::StatusOr<PersonExtrinsicsResult> improve_extrinsics_from_person(PersonExtrinsicsResult result,
                                                                      const SilhouetteSet& silhouettes,
                                                                      const PersonExtrinsicsOptions& options,
                                                                      const SolveProgress& progress) {
    const auto refined = refine_from_silhouettes(result.cameras, silhouettes,
                                                 refinement(options.max_frame_sets, false), progress);
    if (!refined.ok()) return refined.status();
    result.cameras = refined->cameras;
    if (options.estimate_uncertainty) {
        const auto uncertainty = split_half_uncertainty(result.cameras, silhouettes,
                                                        refinement(options.max_frame_sets, false), progress);
        if (!uncertainty.ok()) return uncertainty.status();
        result.uncertainty = *uncertainty;
    }
    result.residual_px = refined->residual_after_px;
    std::vector<int> all(result.cameras.size());
    std::iota(all.begin(), all.end(), 0);
    const auto axis = body_axis(result.cameras, person_landmarks(result.cameras, silhouettes), all);
    const auto world = person_world(result.cameras, silhouettes, axis, options.height_m);
    if (!world)
        return absl::FailedPreconditionError(
            "no frame set shows the whole person in all cameras; let a person walk where all cameras see "
            "head and feet");
    move_cameras(world->world_from_solved, result.cameras);
    result.frame_sets = world->frame_sets;
    result.walked_m = world->way_long_m, result.walked_wide_m = world->way_wide_m;
    judge(*world, max_side_px(result.cameras), result);
    return result;
}

}  // namespace kinevox
