#include "server/calibration/person/diagnosis.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/calibration/multi_view.h"
#include "server/calibration/person/silhouette_hull.h"

namespace kinevox {
namespace {

SilhouetteSet exchanged(SilhouetteSet set, std::size_t a, std::size_t b) {
    for (auto& images : set.frame_sets) std::swap(images[a], images[b]);
    return set;
}

SilhouetteSet rotated_by_180(SilhouetteSet set, std::size_t camera) {
    for (auto& images : set.frame_sets) std::reverse(images[camera].mask.begin(), images[camera].mask.end());
    return set;
}

SilhouetteSet some_of(const SilhouetteSet& set, std::size_t most) {
    SilhouetteSet some;
    const std::size_t count = std::min(most, set.frame_sets.size());
    for (std::size_t n = 0; n < count; ++n)
        some.frame_sets.push_back(set.frame_sets[n * set.frame_sets.size() / count]);
    return some;
}

absl::StatusOr<std::vector<Finding>> diagnose(const std::vector<Camera>& cameras,
                                              const SilhouetteSet& silhouettes,
                                              const DiagnosisOptions& options,
                                              const SolveProgress& progress) {
    const absl::Status cancelled = absl::CancelledError("stopped");
    const std::size_t count = cameras.size();
    const double side = max_side_px(cameras);
    const double good = options.good_residual_fraction * side, bad = options.bad_residual_fraction * side;
    const double before = silhouette_residual_px(cameras, silhouettes, options.refine);
    if (before < good)
        return std::vector<Finding>{
            {Verdict::kGo, "silhouette_residual", "",
             fmt::format("silhouettes and cameras are consistent to {:.1f} px", before), ""}};
    const Verdict verdict = before > bad ? Verdict::kNoGo : Verdict::kCaution;
    std::vector<Finding> findings;
    const SilhouetteSet some = some_of(silhouettes, 16);
    const double some_before = silhouette_residual_px(cameras, some, options.refine);
    for (std::size_t a = 0; a < count; ++a)
        for (std::size_t b = a + 1; b < count; ++b) {
            if (cameras[a].width != cameras[b].width || cameras[a].height != cameras[b].height) continue;
            if (progress && !progress(0.3 * a / count, "testing for swapped cameras")) return cancelled;
            const double after = silhouette_residual_px(cameras, exchanged(some, a, b), options.refine);
            if (after < 0.5 * some_before)
                findings.push_back(
                    {Verdict::kNoGo, "cameras_swapped", cameras[a].name,
                     fmt::format(
                         "cameras {} and {} are swapped: exchanged, the silhouette residual is {:.1f} px "
                         "instead of {:.1f}",
                         cameras[a].name, cameras[b].name, after, some_before),
                     "exchange their videos or cables"});
        }
    if (!findings.empty()) return findings;
    for (std::size_t c = 0; c < count; ++c) {
        if (progress && !progress(0.3 + 0.1 * c / count, "testing for an image upside down"))
            return cancelled;
        const double after = silhouette_residual_px(cameras, rotated_by_180(some, c), options.refine);
        if (after < 0.6 * some_before)
            findings.push_back({Verdict::kNoGo, "image_upside_down", cameras[c].name,
                                fmt::format("camera {} delivers its image upside down: rotated by 180 "
                                            "degrees, the silhouette residual is "
                                            "{:.1f} px instead of {:.1f}",
                                            cameras[c].name, after, some_before),
                                "rotate the camera or its image by 180 degrees"});
    }
    if (!findings.empty()) return findings;
    double best = 1e9, rotation_deg = 0, moved = 0;
    std::size_t moved_camera = 0;
    std::vector<double> released(count, 1e9);
    for (std::size_t c = 0; count > 2 && c < count; ++c) {
        if (progress && !progress(0.4 + 0.6 * c / count, "testing for a moved camera")) return cancelled;
        SilhouetteRefineOptions one = options.refine;
        one.fixed.assign(count, true);
        one.fixed[c] = false;
        one.rounds = 25;
        const auto refined = refine_from_silhouettes(cameras, some, one);
        if (!refined.ok()) continue;
        released[c] = refined->residual_after_px;
        if (refined->residual_after_px < best)
            best = refined->residual_after_px, moved_camera = c, rotation_deg = refined->rotated_deg[c],
            moved = refined->moved_m[c];
    }
    // Exactly one camera that, when released, removes the residuals.
    std::vector<double> sorted = released;
    std::sort(sorted.begin(), sorted.end());
    if (count > 2 && best < 0.7 * some_before && sorted[1] > 1.2 * best)
        findings.push_back({verdict, "camera_moved", cameras[moved_camera].name,
                            fmt::format("camera {} has moved: by {:.1f} degrees and {:.0f} mm since "
                                        "it was calibrated",
                                        cameras[moved_camera].name, rotation_deg, 1000 * moved),
                            "run kinevox calibrate refine, or calibrate again"});
    else
        findings.push_back(
            {verdict, "silhouette_residual", "",
             fmt::format("the silhouette residual is {:.1f} px (up to {:.1f} px is good)", before, good),
             "run kinevox calibrate refine; check whether the silhouettes are complete"});
    return findings;
}

}  // namespace

absl::StatusOr<std::vector<Finding>> diagnose_silhouettes(const std::vector<Camera>& cameras,
                                                          const SilhouetteSet& silhouettes,
                                                          const DiagnosisOptions& options,
                                                          const SolveProgress& progress) {
    auto findings = diagnose(cameras, silhouettes, options, progress);
    constexpr std::size_t kThirds = 3, kMinFrameSets = 5;  // per third
    const std::size_t count = silhouettes.frame_sets.size();
    if (!findings.ok() || worst(*findings) != Verdict::kGo || count < kThirds * kMinFrameSets)
        return findings;
    // An error during a part of the session is diluted in all of it.
    static constexpr const char* kNames[] = {"first", "second", "last"};
    for (const std::size_t third : {kThirds - 1, std::size_t{0}, std::size_t{1}}) {
        SilhouetteSet some;
        some.frame_sets.assign(silhouettes.frame_sets.begin() + third * count / kThirds,
                               silhouettes.frame_sets.begin() + (third + 1) * count / kThirds);
        auto of_third = diagnose(cameras, some, options, progress);
        if (!of_third.ok()) return of_third;
        if (worst(*of_third) == Verdict::kGo) continue;
        for (Finding& finding : *of_third)
            finding.reason += fmt::format(" (in the {} third of the recording)", kNames[third]);
        return of_third;
    }
    return findings;
}

std::optional<SubjectExtent> subject_extent(const std::vector<Camera>& cameras,
                                            const SilhouetteSet& silhouettes) {
    // Of the exact hull: points triangulated from the silhouettes' ends in the images belong to different
    // parts of the body and lie up to a decimetre below the floor.
    std::vector<double> lowest, highest, widths;
    for (const auto& images : silhouettes.frame_sets) {
        const bool truncated = std::ranges::any_of(images, &SilhouetteMask::truncated);
        const SilhouetteHull hull(cameras, images);
        if (truncated || !hull.usable()) continue;
        const auto extent = hull.extent({0, 0, 1});
        if (!extent) continue;
        const Vec3 top = extent->highest, bottom = extent->lowest;
        highest.push_back(top.z), lowest.push_back(bottom.z);
        widths.push_back(std::hypot(top.x - bottom.x, top.y - bottom.y));
    }
    if (highest.size() < 5) return std::nullopt;
    const auto quantile = [](std::vector<double>& values, double fraction) {
        std::sort(values.begin(), values.end());
        return values[static_cast<std::size_t>(fraction * static_cast<double>(values.size() - 1))];
    };
    return SubjectExtent{quantile(lowest, 0.5), quantile(highest, 0.5), quantile(widths, 0.5)};
}

std::vector<Finding> check_world(const std::vector<Camera>& cameras,
                                 const std::optional<SubjectExtent>& subject,
                                 std::optional<double> height_m) {
    std::vector<Finding> findings;
    const auto add = [&](Verdict verdict, const char* check, const std::string& camera, std::string reason,
                         std::string remedy) {
        findings.push_back({verdict, check, camera, std::move(reason), std::move(remedy)});
    };
    std::size_t below = 0;
    for (const Camera& camera : cameras) below += camera.centre_in_world().z <= 0;
    if (below == cameras.size() && below > 0)
        add(Verdict::kNoGo, "target_mirrored", "",
            "all cameras are below the floor: the floor is upside down, as from a mirrored board",
            "define the floor again, with a board whose print is not mirrored, face up");
    for (const Camera& camera : cameras) {
        const double z = camera.centre_in_world().z;
        if (z <= 0 && below < cameras.size())
            add(Verdict::kNoGo, "camera_below_floor", camera.name,
                fmt::format("camera {} is {:.2f} m below the floor", camera.name, -z),
                "define the floor again");
        const double up = -camera.camera_from_world.rotation(1, 2);
        if (z > 0 && up < -0.5)
            add(Verdict::kCaution, "camera_upside_down", camera.name,
                fmt::format("camera {} is mounted upside down", camera.name),
                "none if intended; else rotate it and calibrate again");
    }
    if (!subject) return findings;
    const double height = subject->highest_m - subject->lowest_m;
    if (height < 0.25 && subject->width_m < 0.25) return findings;  // no standing person
    if (height < subject->width_m)
        add(Verdict::kNoGo, "subject_not_upright", "",
            "the subject does not stand upright in this world frame", "define the floor again");
    else if (std::abs(subject->lowest_m) > 0.10)
        add(std::abs(subject->lowest_m) > 0.3 ? Verdict::kNoGo : Verdict::kCaution, "feet_height", "",
            fmt::format("the subject's feet are {:.2f} m {} the floor", std::abs(subject->lowest_m),
                        subject->lowest_m < 0 ? "under" : "above"),
            "define the floor again (none if the subject stands on an object)");
    if (height_m) {
        const double fraction = height / *height_m - 1;
        if (std::abs(fraction) > 0.03)
            add(std::abs(fraction) > 0.06 ? Verdict::kNoGo : Verdict::kCaution, "scale", "",
                fmt::format(
                    "the subject is measured {:.2f} m tall instead of {:.2f} m: all lengths are {:.0f} "
                    "% too {}, as from a wrong square size",
                    height, *height_m, 100 * std::abs(fraction), fraction > 0 ? "long" : "short"),
                "measure the board's squares with a ruler and calibrate again with their true size");
    } else if (height > subject->width_m && (height < 1.1 || height > 2.25)) {
        add(Verdict::kNoGo, "scale", "",
            fmt::format("the subject is measured {:.2f} m tall: the scale is wrong", height),
            "measure the board's squares with a ruler and calibrate again with their true size");
    }
    return findings;
}

}  // namespace kinevox
