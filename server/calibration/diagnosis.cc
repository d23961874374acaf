#include "server/calibration/diagnosis.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/calibration/triangulation.h"

namespace kinevox {
namespace {

SilhouetteSet exchanged(SilhouetteSet set, std::size_t a, std::size_t b) {
    for (auto& pictures : set.moments) std::swap(pictures[a], pictures[b]);
    return set;
}

SilhouetteSet turned_round(SilhouetteSet set, std::size_t camera) {
    for (auto& pictures : set.moments)
        std::reverse(pictures[camera].mask.begin(), pictures[camera].mask.end());
    return set;
}

SilhouetteSet some_of(const SilhouetteSet& set, std::size_t most) {
    SilhouetteSet some;
    const std::size_t count = std::min(most, set.moments.size());
    for (std::size_t n = 0; n < count; ++n)
        some.moments.push_back(set.moments[n * set.moments.size() / count]);
    return some;
}

absl::StatusOr<std::vector<Finding>> diagnose_together(const std::vector<Camera>& cameras,
                                                       const SilhouetteSet& silhouettes,
                                                       const DiagnosisOptions& options,
                                                       const SolveProgress& progress) {
    const absl::Status cancelled = absl::CancelledError("stopped");
    const std::size_t count = cameras.size();
    const double side = max_side_px(cameras);
    const double good = options.good_miss_part * side, bad = options.bad_miss_part * side;
    const double before = silhouette_miss_px(cameras, silhouettes, options.refine);
    if (before < good)
        return std::vector<Finding>{{Verdict::kGo, "silhouettes", "",
                                     fmt::format("silhouettes and cameras agree to {:.1f} px", before), ""}};
    const Verdict verdict = before > bad ? Verdict::kNoGo : Verdict::kCare;
    std::vector<Finding> findings;
    const SilhouetteSet some = some_of(silhouettes, 16);
    const double some_before = silhouette_miss_px(cameras, some, options.refine);
    for (std::size_t a = 0; a < count; ++a)
        for (std::size_t b = a + 1; b < count; ++b) {
            if (cameras[a].width != cameras[b].width || cameras[a].height != cameras[b].height) continue;
            if (progress && !progress(0.3 * a / count, "whether cameras are swapped")) return cancelled;
            const double after = silhouette_miss_px(cameras, exchanged(some, a, b), options.refine);
            if (after < 0.5 * some_before)
                findings.push_back(
                    {Verdict::kNoGo, "swapped", cameras[a].name,
                     fmt::format("cameras {} and {} are swapped: exchanged, silhouettes miss by {:.1f} px "
                                 "instead of {:.1f}",
                                 cameras[a].name, cameras[b].name, after, some_before),
                     "exchange their videos or cables"});
        }
    if (!findings.empty()) return findings;
    for (std::size_t c = 0; c < count; ++c) {
        if (progress && !progress(0.3 + 0.1 * c / count, "whether a picture is upside down"))
            return cancelled;
        const double after = silhouette_miss_px(cameras, turned_round(some, c), options.refine);
        if (after < 0.6 * some_before)
            findings.push_back(
                {Verdict::kNoGo, "upside_down", cameras[c].name,
                 fmt::format("camera {} delivers its picture upside down: turned round, silhouettes miss by "
                             "{:.1f} px instead of {:.1f}",
                             cameras[c].name, after, some_before),
                 "turn the camera or its picture by 180 degrees"});
    }
    if (!findings.empty()) return findings;
    double best = 1e9, turned = 0, moved = 0;
    std::size_t knocked = 0;
    std::vector<double> released(count, 1e9);
    for (std::size_t c = 0; count > 2 && c < count; ++c) {
        if (progress && !progress(0.4 + 0.6 * c / count, "whether a camera was knocked")) return cancelled;
        SilhouetteRefineOptions one = options.refine;
        one.fixed.assign(count, true);
        one.fixed[c] = false;
        one.rounds = 25;
        const auto refined = refine_from_silhouettes(cameras, some, one);
        if (!refined.ok()) continue;
        released[c] = refined->miss_after_px;
        if (refined->miss_after_px < best)
            best = refined->miss_after_px, knocked = c, turned = refined->turned_deg[c],
            moved = refined->moved_m[c];
    }
    // One camera released mends it, and no other camera does as well.
    std::vector<double> sorted = released;
    std::sort(sorted.begin(), sorted.end());
    if (count > 2 && best < 0.7 * some_before && sorted[1] > 1.2 * best)
        findings.push_back(
            {verdict, "knocked", cameras[knocked].name,
             fmt::format(
                 "camera {} was knocked: it has turned by {:.1f} degrees and moved by {:.0f} mm since "
                 "it was calibrated",
                 cameras[knocked].name, turned, 1000 * moved),
             "run kinevox calibrate refine, or calibrate again"});
    else
        findings.push_back(
            {verdict, "silhouettes", "",
             fmt::format("silhouettes miss the cameras' volume by {:.1f} px (up to {:.1f} px is good)",
                         before, good),
             "run kinevox calibrate refine; look whether the silhouettes are whole"});
    return findings;
}

}  // namespace

absl::StatusOr<std::vector<Finding>> diagnose_silhouettes(const std::vector<Camera>& cameras,
                                                          const SilhouetteSet& silhouettes,
                                                          const DiagnosisOptions& options,
                                                          const SolveProgress& progress) {
    auto findings = diagnose_together(cameras, silhouettes, options, progress);
    constexpr std::size_t kParts = 3, kFewest = 5;  // moments in a part
    const std::size_t count = silhouettes.moments.size();
    if (!findings.ok() || worst(*findings) != Verdict::kGo || count < kParts * kFewest) return findings;
    // What went wrong during the recording is diluted in all of it.
    static constexpr const char* kNames[] = {"first", "second", "last"};
    for (const std::size_t part : {kParts - 1, std::size_t{0}, std::size_t{1}}) {
        SilhouetteSet some;
        some.moments.assign(silhouettes.moments.begin() + part * count / kParts,
                            silhouettes.moments.begin() + (part + 1) * count / kParts);
        auto of_part = diagnose_together(cameras, some, options, progress);
        if (!of_part.ok()) return of_part;
        if (worst(*of_part) == Verdict::kGo) continue;
        for (Finding& finding : *of_part)
            finding.reason += fmt::format(" (in the {} third of the recording)", kNames[part]);
        return of_part;
    }
    return findings;
}

std::optional<SubjectExtent> subject_extent(const std::vector<Camera>& cameras,
                                            const SilhouetteSet& silhouettes) {
    // From the outline's highest and lowest points as the cameras see them: no hull is needed, and none is
    // trusted yet.
    std::vector<double> lowest, highest, widths;
    for (const auto& pictures : silhouettes.moments) {
        std::vector<Sight> tops, bottoms;
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            if (pictures[c].empty() || pictures[c].cut) continue;
            const int w = cameras[c].width, h = cameras[c].height;
            // Along the picture's direction of the world's up, so that a camera may hang as it likes.
            const Mat3& r = cameras[c].camera_from_world.rotation;
            const double up_x = r(0, 2), up_y = r(1, 2);
            double most = -1e18, least = 1e18;
            Vec2 top, bottom;
            for (int y = 0; y < h; ++y)
                for (int x = 0; x < w; ++x) {
                    if (!pictures[c].mask[static_cast<std::size_t>(y) * w + x]) continue;
                    const double along = up_x * x + up_y * y;
                    if (along > most) most = along, top = {1.0 * x, 1.0 * y};
                    if (along < least) least = along, bottom = {1.0 * x, 1.0 * y};
                }
            if (most < least) continue;
            tops.push_back({&cameras[c], top});
            bottoms.push_back({&cameras[c], bottom});
        }
        const auto top = triangulate(tops), bottom = triangulate(bottoms);
        if (!top || !bottom) continue;
        highest.push_back(top->z), lowest.push_back(bottom->z);
        widths.push_back(std::hypot(top->x - bottom->x, top->y - bottom->y));
    }
    if (highest.size() < 5) return std::nullopt;
    const auto quantile = [](std::vector<double>& values, double part) {
        std::sort(values.begin(), values.end());
        return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
    };
    return SubjectExtent{quantile(lowest, 0.3), quantile(highest, 0.8), quantile(widths, 0.5)};
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
        add(Verdict::kNoGo, "mirrored", "",
            "all cameras lie below the floor: the floor is upside down, as from a mirrored board",
            "set the floor again, with a board whose print is not mirrored, face up");
    for (const Camera& camera : cameras) {
        const double z = camera.centre_in_world().z;
        if (z <= 0 && below < cameras.size())
            add(Verdict::kNoGo, "below_floor", camera.name,
                fmt::format("camera {} lies {:.2f} m below the floor", camera.name, -z),
                "set the floor again");
        const double up = -camera.camera_from_world.rotation(1, 2);
        if (z > 0 && up < -0.5)
            add(Verdict::kCare, "upside_down", camera.name,
                fmt::format("camera {} hangs upside down", camera.name),
                "nothing, if it is mounted so; else turn it and calibrate again");
    }
    if (!subject) return findings;
    const double height = subject->highest_m - subject->lowest_m;
    if (height < 0.25 && subject->width_m < 0.25) return findings;  // nobody stood
    if (height < subject->width_m)
        add(Verdict::kNoGo, "not_upright", "", "the subject does not stand upright in this world",
            "set the floor again");
    else if (std::abs(subject->lowest_m) > 0.10)
        add(std::abs(subject->lowest_m) > 0.3 ? Verdict::kNoGo : Verdict::kCare, "floor", "",
            fmt::format("the subject's feet are {:.2f} m {} the floor", std::abs(subject->lowest_m),
                        subject->lowest_m < 0 ? "under" : "above"),
            "set the floor again (nothing, if the subject stands on something)");
    if (height_m) {
        const double part = height / *height_m - 1;
        if (std::abs(part) > 0.03)
            add(std::abs(part) > 0.06 ? Verdict::kNoGo : Verdict::kCare, "scale", "",
                fmt::format("the subject comes out {:.2f} m tall instead of {:.2f} m: all lengths are {:.0f} "
                            "% too {}, as from "
                            "a wrong square size",
                            height, *height_m, 100 * std::abs(part), part > 0 ? "long" : "short"),
                "measure the board's squares with a ruler and calibrate again with their true size");
    } else if (height > subject->width_m && (height < 1.1 || height > 2.25)) {
        add(Verdict::kNoGo, "scale", "",
            fmt::format("the subject comes out {:.2f} m tall: the scale is wrong", height),
            "measure the board's squares with a ruler and calibrate again with their true size");
    }
    return findings;
}

}  // namespace kinevox
