#include "server/calibration/person_extrinsics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/calib3d.hpp>

#include "server/calibration/bundle.h"
#include "server/calibration/camera_tree.h"
#include "server/calibration/median.h"
#include "server/calibration/person_landmarks.h"
#include "server/calibration/person_world.h"
#include "server/calibration/silhouette_refine.h"
#include "server/calibration/triangulation.h"
#include "server/calibration/unit_plane.h"

namespace kinevox {
namespace {

constexpr std::size_t kMinTogether = 12;   // moments
constexpr double kTopToMiddlePart = 0.42;  // of a person's height, from the top of the head to the centre
constexpr int kTries = 3;                  // of the first places, by landmarks drawn differently
constexpr double kSureMissPart = 0.001;  // of the picture's longer side: first places that need no other try
constexpr double kGoodMissPart = 0.002;  // more than that are not to be trusted
constexpr double kStayed_m = 0.5, kWayLong_m = 1.5;  // over which the subject should walk
constexpr double kSureCentre_mm = 60,
                 kSureTurn_deg = 1.0;  // between the recording's halves: more is not sure
constexpr double kUnknownCentre_mm = 300, kUnknownTurn_deg = 5;  // and more is no calibration
constexpr double kUnevenHeight = 1.08;  // upper over middle height of the hulls: bent, or arms raised

using Landmarks = std::vector<std::vector<std::optional<PersonLandmarks>>>;  // [moment][camera]

// The length of the upper body, in units of the two cameras' distance, makes all pairs' units the same.
std::optional<CameraPair> join(const std::vector<Camera>& lenses, const Landmarks& landmarks, int a, int b,
                               const PersonExtrinsicsOptions& options, int attempt) {
    std::vector<cv::Point2d> in_a, in_b;
    for (const auto& moment : landmarks) {
        if (!moment[a] || !moment[b]) continue;
        for (int k = 0; k < kPersonLandmarks; ++k) {
            in_a.push_back(on_unit_plane(lenses[a], (*moment[a])[k]));
            in_b.push_back(on_unit_plane(lenses[b], (*moment[b])[k]));
        }
    }
    if (in_a.size() < kPersonLandmarks * kMinTogether) return std::nullopt;
    cv::setRNGSeed(1 + attempt);
    cv::Mat inside, rotation, shift, points;
    const double side = std::max(lenses[a].width, lenses[a].height);
    const double threshold =
        options.landmark_px_part * (1 - 0.25 * attempt) * side / std::min(lenses[a].fx, lenses[b].fx);
    const cv::Mat essential =
        cv::findEssentialMat(in_b, in_a, cv::Mat::eye(3, 3, CV_64F), cv::RANSAC, 0.9999, threshold, inside);
    if (essential.rows != 3) return std::nullopt;
    const int good = cv::recoverPose(essential, in_b, in_a, cv::Mat::eye(3, 3, CV_64F), rotation, shift, 1e3,
                                     inside, points);
    if (good < static_cast<int>(kPersonLandmarks * kMinTogether) / 2) return std::nullopt;
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
    if (lengths.size() < kMinTogether / 2) return std::nullopt;
    const double length = median_of(lengths);
    if (!(length > 0)) return std::nullopt;
    CameraPair pair{a, b, {}, good};
    for (int i = 0; i < 9; ++i) pair.a_from_b.rotation.m[i] = rotation.at<double>(i / 3, i % 3);
    pair.a_from_b.translation = (kTopToMiddlePart * options.height_m / length) *
                                Vec3{shift.at<double>(0), shift.at<double>(1), shift.at<double>(2)};
    return pair;
}

// Every landmark of every moment is a point of its own.
absl::Status adjust(std::vector<Camera>& cameras, const Landmarks& landmarks,
                    const std::vector<int>& camera_of, double robust_px) {
    Bundle bundle;
    bundle.cameras = cameras;
    bundle.points_in_thing = {{0, 0, 0}};
    for (const auto& moment : landmarks)
        for (int k = 0; k < kPersonLandmarks; ++k) {
            std::vector<Sight> sights;
            std::vector<int> seen;
            for (std::size_t c = 0; c < cameras.size(); ++c)
                if (moment[camera_of[c]]) {
                    sights.push_back({&cameras[c], (*moment[camera_of[c]])[k]});
                    seen.push_back(static_cast<int>(c));
                }
            const auto point = triangulate(sights);
            if (!point) continue;
            const int thing = static_cast<int>(bundle.world_from_thing.size());
            bundle.world_from_thing.push_back({{}, *point});
            for (std::size_t i = 0; i < seen.size(); ++i)
                bundle.observations.push_back({seen[i], thing, 0, sights[i].pixel, {}, {}});
        }
    BundleOptions options;
    options.robust_px = robust_px;
    options.fixed_turns = true;
    BundleReport report;
    if (absl::Status solved = solve_bundle(bundle, options, report); !solved.ok()) return solved;
    cameras = bundle.cameras;
    return absl::OkStatus();
}

// Anew each time: places may be improved.
void judge(const PersonWorld& world, double side_px, PersonExtrinsicsResult& result) {
    std::erase_if(result.findings, [](const Finding& f) { return f.check != "unconnected"; });
    const auto add = [&](Verdict verdict, const char* check, std::string reason, const char* remedy) {
        result.findings.push_back({verdict, check, "", std::move(reason), remedy});
    };
    const bool little = world.way_long_m < kWayLong_m;
    // Not told by a few moments: not sure, but not hopeless either.
    const double centre_mm = result.uncertainty ? result.uncertainty->centre_mm : kUnknownCentre_mm,
                 turn_deg = result.uncertainty ? result.uncertainty->turn_deg : kUnknownTurn_deg;
    const bool unsure = centre_mm > kSureCentre_mm || turn_deg > kSureTurn_deg,
               unknown = centre_mm > kUnknownCentre_mm || turn_deg > kUnknownTurn_deg;
    if (result.miss_px > kGoodMissPart * side_px)
        add(Verdict::kNoGo, "silhouettes",
            fmt::format("the outlines miss each other by {:.1f} px; {:.1f} px would be good", result.miss_px,
                        kGoodMissPart * side_px),
            "look whether the silhouettes are whole and the cameras synchronised, and calibrate again");
    // Both halves have the same mistakes then, and agree.
    if (world.way_long_m < kStayed_m)
        add(Verdict::kNoGo, "movement",
            fmt::format(
                "the person stayed at one place, within {:.1f} m: that leaves the cameras' places open by a "
                "decimetre and more",
                world.way_long_m),
            "let the person walk round through the whole space, best in a circle of two metres or more");
    else if (little || unsure)
        add(unknown ? Verdict::kNoGo : Verdict::kCare, "movement",
            fmt::format("the person moved over {:.1f} m by {:.1f} m; {}", world.way_long_m, world.way_wide_m,
                        !result.uncertainty
                            ? "how certain the places are cannot be told from so few moments"
                            : fmt::format("the two halves of the recording give places that differ by "
                                          "{:.0f} mm and {:.1f} degrees",
                                          centre_mm, turn_deg)),
            "let the person walk round through the whole space, best in a circle of two metres or more");
    if (world.uneven_height > kUnevenHeight)
        add(Verdict::kCare, "scale",
            fmt::format(
                "the person's height varies by {:.0f} %: bent down or with raised arms, so that the scale is "
                "uncertain",
                100 * (world.uneven_height - 1)),
            "let the person walk upright with the arms down");
}

SilhouetteSet of_cameras(const SilhouetteSet& all, const std::vector<int>& camera_of) {
    SilhouetteSet some;
    for (const auto& moment : all.moments) {
        std::vector<SilhouettePicture> pictures;
        for (const int c : camera_of) pictures.push_back(moment[c]);
        some.moments.push_back(std::move(pictures));
    }
    return some;
}

// Wide enough for places that are off by ten degrees, then on the outlines alone.
SilhouetteRefineOptions refinement(int moments, bool wide) {
    SilhouetteRefineOptions options;
    options.max_moments = moments;
    options.outline_points = wide ? 56 : 24;
    options.rounds = wide ? 30 : 40;
    options.tangent_weight = 3, options.tangent_scale = 0.2;
    // The places before say nothing: a little, lest the world drifts.
    options.prior_angle_deg = 30, options.prior_shift_m = 5;
    options.first_scale_part = wide ? 0.05 : 0.008;
    options.last_scale_part = wide ? 0.006 : 0.002;
    return options;
}

// From the middle to the top of the head, on average.
Vec3 body_axis(const std::vector<Camera>& cameras, const Landmarks& landmarks,
               const std::vector<int>& camera_of) {
    Vec3 sum;
    for (const auto& moment : landmarks) {
        std::vector<Sight> tops, middles;
        for (std::size_t c = 0; c < cameras.size(); ++c)
            if (const auto& seen = moment[camera_of[c]]) {
                tops.push_back({&cameras[c], seen->front()});
                middles.push_back({&cameras[c], seen->back()});
            }
        const auto top = triangulate(tops), middle = triangulate(middles);
        if (top && middle) sum += normalized(*top - *middle);
    }
    return sum;
}

struct Places {
    std::vector<Camera> cameras;
    std::vector<int> camera_of;  // index among all
    double miss_px = 1e9;
};

absl::StatusOr<Places> first_places(const std::vector<Camera>& lenses, const Landmarks& landmarks,
                                    const SilhouetteSet& silhouettes, const PersonExtrinsicsOptions& options,
                                    int attempt) {
    std::vector<CameraPair> pairs;
    const int count = static_cast<int>(lenses.size());
    for (int a = 0; a < count; ++a)
        for (int b = a + 1; b < count; ++b)
            if (const auto pair = join(lenses, landmarks, a, b, options, attempt)) pairs.push_back(*pair);
    if (pairs.empty())
        return absl::FailedPreconditionError(fmt::format(
            "no two cameras have seen the whole person together in {} moments or more, from head to feet "
            "and at different places; let a person walk through the whole space for half a minute",
            kMinTogether));
    const CameraTree tree = join_cameras(count, pairs);
    Places places;
    places.camera_of = tree.groups.front();
    for (const int c : places.camera_of) {
        places.cameras.push_back(lenses[c]);
        places.cameras.back().camera_from_world = tree.camera_from_world[c];
    }
    const double robust_px = 0.25 * options.landmark_px_part * max_side_px(lenses);
    if (absl::Status adjusted = adjust(places.cameras, landmarks, places.camera_of, robust_px);
        !adjusted.ok())
        return adjusted;
    const SilhouetteSet seen = of_cameras(silhouettes, places.camera_of);
    auto refined = refine_from_silhouettes(places.cameras, seen, refinement(options.first_moments, true));
    if (!refined.ok()) return refined.status();
    places.cameras = refined->cameras;
    places.miss_px = refined->miss_after_px;
    return places;
}

}  // namespace

absl::StatusOr<PersonExtrinsicsResult> extrinsics_from_person(const std::vector<Camera>& lenses,
                                                              const SilhouetteSet& silhouettes,
                                                              const PersonExtrinsicsOptions& options,
                                                              const SolveProgress& progress) {
    const absl::Status cancelled = absl::CancelledError("stopped; nothing was changed");
    if (progress && !progress(0.02, "head and middle in every picture")) return cancelled;
    const Landmarks landmarks = person_landmarks(lenses, silhouettes);
    Places best;
    for (int attempt = 0; attempt < kTries; ++attempt) {
        if (progress && !progress(0.05 + 0.2 * attempt, "first places of the cameras")) return cancelled;
        auto places = first_places(lenses, landmarks, silhouettes, options, attempt);
        if (!places.ok()) {
            if (attempt == 0) return places.status();
            continue;
        }
        const bool more = places->cameras.size() > best.cameras.size();
        if (more || (places->cameras.size() == best.cameras.size() && places->miss_px < best.miss_px))
            best = *std::move(places);
        if (best.cameras.size() == lenses.size() && best.miss_px < kSureMissPart * max_side_px(lenses)) break;
    }
    const SilhouetteSet seen = of_cameras(silhouettes, best.camera_of);
    const SolveProgress within = [&](double part, const std::string& what) {
        return !progress || progress(0.65 + 0.3 * part, what);
    };
    PersonExtrinsicsResult result;
    result.cameras = best.cameras;
    for (std::size_t c = 0; c < lenses.size(); ++c)
        if (std::find(best.camera_of.begin(), best.camera_of.end(), static_cast<int>(c)) ==
            best.camera_of.end()) {
            result.left_out.push_back(lenses[c].name);
            result.findings.push_back(
                {Verdict::kNoGo, "unconnected", lenses[c].name,
                 fmt::format("camera {} saw too little of the person together with the others",
                             lenses[c].name),
                 "let the person walk where it and another camera see them from head to feet"});
        }
    return improve_extrinsics_from_person(std::move(result), seen, options, within);
}

absl::StatusOr<PersonExtrinsicsResult> improve_extrinsics_from_person(PersonExtrinsicsResult result,
                                                                      const SilhouetteSet& silhouettes,
                                                                      const PersonExtrinsicsOptions& options,
                                                                      const SolveProgress& progress) {
    const auto refined = refine_from_silhouettes(result.cameras, silhouettes,
                                                 refinement(options.max_moments, false), progress);
    if (!refined.ok()) return refined.status();
    result.cameras = refined->cameras;
    if (options.tell_uncertainty) {
        const auto told =
            places_uncertainty(result.cameras, silhouettes, refinement(options.max_moments, false), progress);
        if (!told.ok()) return told.status();
        result.uncertainty = *told;
    }
    result.miss_px = refined->miss_after_px;
    std::vector<int> all(result.cameras.size());
    std::iota(all.begin(), all.end(), 0);
    const auto axis = body_axis(result.cameras, person_landmarks(result.cameras, silhouettes), all);
    const auto world = person_world(result.cameras, silhouettes, axis, options.height_m);
    if (!world)
        return absl::FailedPreconditionError(
            "the person was never whole in all pictures; let a person walk where all cameras see head and "
            "feet");
    move_cameras(world->world_from_solved, result.cameras);
    result.moments = world->moments;
    result.walked_m = world->way_long_m, result.walked_wide_m = world->way_wide_m;
    judge(*world, max_side_px(result.cameras), result);
    return result;
}

}  // namespace kinevox
