#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "common/geometry.h"
#include "server/calibration/board/extrinsics.h"
#include "server/calibration/board/posed_views.h"
#include "server/calibration/coverage.h"
#include "server/calibration/multi_view.h"

namespace kinevox {
namespace {

constexpr double kSuspiciousPx = 0.7;   // held-out error above which hypotheses are tested
constexpr double kPoorCoverage = 0.26;  // fraction of the image

// A subset of the frame sets, to test hypotheses quickly.
Bundle some_frame_sets(const Bundle& bundle, int most) {
    Bundle some = bundle;
    some.world_from_target.clear(), some.observations.clear();
    const int all = static_cast<int>(bundle.world_from_target.size()), step = std::max(1, all / most);
    std::vector<int> index(all, -1);
    for (int m = 0; m < all; m += step) {
        index[m] = static_cast<int>(some.world_from_target.size());
        some.world_from_target.push_back(bundle.world_from_target[m]);
    }
    for (BundleObservation o : bundle.observations) {
        o.frame_set = index[o.frame_set];
        if (o.frame_set >= 0) some.observations.push_back(o);
    }
    return some;
}

// Root mean square error after a solve, outliers counted as 30 px.
double solved_px(Bundle& bundle) {
    BundleOptions options;
    options.max_iterations = 60;
    options.robust_px = 20;  // wide, to escape a wrong initial guess
    BundleReport report;
    if (!solve_bundle(bundle, options, report).ok()) return 1e9;
    double sum = 0;
    for (const double error : report.errors_px)
        sum += std::isfinite(error) ? std::min(error * error, 900.0) : 900.0;
    return std::sqrt(sum / static_cast<double>(report.errors_px.size()));
}

bool find_swapped(const Bundle& some, const std::string& target, double before_px,
                  std::vector<Finding>& findings) {
    bool found = false;
    for (std::size_t a = 0; a < some.cameras.size(); ++a)
        for (std::size_t b = a + 1; b < some.cameras.size(); ++b) {
            if (some.cameras[a].width != some.cameras[b].width ||
                some.cameras[a].height != some.cameras[b].height)
                continue;
            Bundle tried = some;
            std::swap(tried.cameras[a], tried.cameras[b]);
            std::swap(tried.cameras[a].camera_from_world, tried.cameras[b].camera_from_world);
            const double after_px = solved_px(tried);
            if (after_px > 0.5 * before_px) continue;
            found = true;
            findings.push_back(
                {Verdict::kNoGo, "cameras_swapped", some.cameras[a].name,
                 fmt::format("cameras {} and {} are swapped: with exchanged intrinsics the reprojection "
                             "error of the {} is {:.2f} px "
                             "instead of {:.2f}",
                             some.cameras[a].name, some.cameras[b].name, target, after_px, before_px),
                 "exchange the two cameras' names or cables, then calibrate again"});
        }
    return found;
}

// A camera that two poses, before and after some frame set, fit much better than one.
void find_moved(const Bundle& some, const std::string& target, double before_px,
                std::vector<Finding>& findings) {
    const int frame_sets = static_cast<int>(some.world_from_target.size());
    double best_px = 0.65 * before_px, rotation_deg = 0, moved = 0;
    int which = -1;
    for (std::size_t c = 0; c < some.cameras.size(); ++c)
        for (const double fraction : {0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8}) {
            Bundle split = some;
            split.cameras.push_back(some.cameras[c]);
            if (!split.delay.empty()) split.delay.push_back(split.delay[c]);
            for (BundleObservation& o : split.observations)
                if (o.camera == static_cast<int>(c) && o.frame_set >= fraction * frame_sets)
                    o.camera = static_cast<int>(some.cameras.size());
            const double after_px = solved_px(split);
            if (after_px >= best_px) continue;
            best_px = after_px, which = static_cast<int>(c);
            const Camera &early = split.cameras[c], &late = split.cameras.back();
            rotation_deg =
                degrees(angle_between(early.camera_from_world.rotation, late.camera_from_world.rotation));
            moved = norm(early.centre_in_world() - late.centre_in_world());
        }
    if (which >= 0 && (rotation_deg > 0.1 || moved > 0.01))
        findings.push_back(
            {Verdict::kNoGo, "camera_moved", some.cameras[which].name,
             fmt::format("camera {} moved while the {} was captured, by {:.1f} degrees and {:.0f} mm",
                         some.cameras[which].name, target, rotation_deg, 1000 * moved),
             "fix the camera firmly and calibrate again"});
}

// A camera without which the others are consistent.
void find_odd_one(const Bundle& some, const std::string& target, double before_px,
                  std::vector<Finding>& findings) {
    if (some.cameras.size() < 3) return;
    double best_px = 0.3 * before_px;
    int which = -1;
    for (std::size_t c = 0; c < some.cameras.size(); ++c) {
        Bundle without = some;
        std::erase_if(without.observations,
                      [&](const BundleObservation& o) { return o.camera == static_cast<int>(c); });
        const double after_px = without.observations.empty() ? 1e9 : solved_px(without);
        if (after_px < best_px) best_px = after_px, which = static_cast<int>(c);
    }
    if (which < 0) return;
    const std::string& name = some.cameras[which].name;
    findings.push_back(
        {Verdict::kNoGo, "inconsistent_camera", name,
         fmt::format("camera {} is inconsistent with the others: without it the reprojection error of the {} "
                     "is {:.2f} px instead of {:.2f}",
                     name, target, best_px, before_px),
         "check whether its image is mirrored, its intrinsics belong to another camera, its zoom or "
         "focus changed, or its video is not synchronised"});
}

// Residuals of one camera, an even selection.
std::vector<PixelResidual> sample_residuals(const Bundle& bundle, int camera) {
    constexpr std::size_t kMaxPoints = 400;
    std::vector<PixelResidual> all;
    for (const BundleObservation& o : bundle.observations) {
        if (o.camera != camera) continue;
        const auto expected = bundle.cameras[camera].project(observed_point(bundle, o));
        if (expected) all.push_back({o.pixel, {o.pixel.x - expected->x, o.pixel.y - expected->y}});
    }
    std::vector<PixelResidual> some;
    const std::size_t used = std::min(kMaxPoints, all.size());
    for (std::size_t i = 0; i < used; ++i) some.push_back(all[i * all.size() / used]);
    return some;
}

void explain_errors(const Bundle& bundle, const std::string& target, std::vector<Finding>& findings) {
    Bundle some = some_frame_sets(bundle, 40);
    const double before_px = solved_px(some);
    const std::size_t count_before = findings.size();
    if (!find_swapped(some, target, before_px, findings)) find_moved(some, target, before_px, findings);
    if (findings.size() == count_before) find_odd_one(some, target, before_px, findings);
}

void check_camera(const Bundle& bundle, const std::string& target, int c, double all_px,
                  ExtrinsicsResult& result) {
    const auto add = [&](Verdict verdict, const char* check, std::string reason, std::string remedy) {
        result.findings.push_back(
            {verdict, check, result.cameras[c].name, std::move(reason), std::move(remedy)});
    };
    const CameraReprojection& q = result.reprojections[c];
    const std::string& name = result.cameras[c].name;
    const double px = q.held_out_rms_px.value_or(q.fit_rms_px);
    if (px > std::max(0.8, 2.5 * all_px))
        add(px > 3 ? Verdict::kNoGo : Verdict::kCaution, "camera_reprojection",
            fmt::format("the reprojection error of camera {} is {:.2f} px, of all cameras {:.2f} px", name,
                        px, all_px),
            "check that it did not move, and calibrate its intrinsics again");
    if (q.views < 6)
        add(q.views < 4 ? Verdict::kNoGo : Verdict::kCaution, "too_few_views",
            fmt::format("camera {} shares only {} views of the {} with others", name, q.views, target),
            fmt::format("show it the {} in ten or more positions", target));
    if (q.coverage < kPoorCoverage) {
        Coverage coverage(bundle.cameras[c].width, bundle.cameras[c].height);
        for (const BundleObservation& o : bundle.observations)
            if (o.camera == c) coverage.add(o.pixel);
        add(Verdict::kCaution, "coverage",
            fmt::format(
                "camera {} is poorly covered: the {} was detected in {:.0f} % of its image, {} is the "
                "emptiest region",
                name, target, 100 * q.coverage, coverage.emptiest()),
            fmt::format("hold the {} also in {} of its image", target, coverage.emptiest()));
    }
}

// A board with constant tilt hardly determines the scale along its normal. A wand has a direction only.
void check_tilt(const Bundle& bundle, TargetKind kind, std::vector<Finding>& findings) {
    const int axis = kind == TargetKind::kBoard ? 2 : 0;
    double max_rotation_deg = 0;
    for (const Rigid3& a : bundle.world_from_target) {
        const Mat3 &r = a.rotation, &first = bundle.world_from_target.front().rotation;
        const double cosine =
            r(0, axis) * first(0, axis) + r(1, axis) * first(1, axis) + r(2, axis) * first(2, axis);
        // The ends of the wand are equivalent.
        const double rotation_deg =
            degrees(std::acos(std::clamp(kind == TargetKind::kWand ? std::abs(cosine) : cosine, -1.0, 1.0)));
        max_rotation_deg = std::max(max_rotation_deg, rotation_deg);
    }
    if (max_rotation_deg >= 12) return;
    if (kind == TargetKind::kBoard)
        findings.push_back(
            {Verdict::kCaution, "uniform_tilt", "",
             fmt::format("the board had the same tilt in all views (it varied by at most {:.0f} degrees)",
                         max_rotation_deg),
             "tilt the board by 20 to 45 degrees, in several directions"});
    else
        findings.push_back(
            {Verdict::kCaution, "uniform_tilt", "",
             fmt::format("the wand had the same direction in all views (it varied by at most {:.0f} degrees)",
                         max_rotation_deg),
             "hold the wand in all directions while you move it"});
}

}  // namespace

std::vector<Finding> check_views(const PosedViews& views) {
    std::vector<Finding> findings;
    int all = 0, behind = 0;
    for (const auto& [frame_set, seen] : views.all())
        for (const PosedView& view : seen) {
            ++all;
            behind += view.pose.tilt_rad > std::numbers::pi / 2;
        }
    if (all > 0 && 2 * behind > all)
        findings.push_back({Verdict::kNoGo, "target_mirrored", "",
                            "the board is mirrored: all cameras seem to see its print from behind, and a "
                            "floor defined by it would be upside down",
                            "print the board unmirrored, or give its corners in the right order"});
    return findings;
}

std::optional<ScaleError> scale_error(const Bundle& bundle) {
    std::map<std::pair<int, int>, std::vector<Observation>> observations;
    for (const BundleObservation& o : bundle.observations)
        observations[{o.frame_set, o.point}].push_back({&bundle.cameras[o.camera], o.pixel});
    std::map<int, std::map<int, Vec3>> points;  // [frame set][point]
    for (const auto& [key, seen] : observations)
        if (const auto point = triangulate(seen)) points[key.first][key.second] = *point;
    double sum = 0, squares = 0;
    int count = 0;
    for (const auto& [frame_set, triangulated] : points)
        for (auto a = triangulated.begin(); a != triangulated.end(); ++a)
            for (auto b = std::next(a); b != triangulated.end(); ++b) {
                const double truth =
                    norm(bundle.points_in_target[a->first] - bundle.points_in_target[b->first]);
                const double error = 1000 * (norm(a->second - b->second) - truth) / truth;
                sum += error, squares += error * error, ++count;
            }
    if (count < 10) return std::nullopt;
    const double mean = sum / count;
    return ScaleError{mean, std::sqrt(std::max(0.0, squares / count - mean * mean)), count};
}

std::vector<CameraReprojection> camera_reprojections(const Bundle& fit, const BundleReport& fit_report,
                                                     const Bundle& held_out,
                                                     const BundleReport& held_report) {
    std::vector<CameraReprojection> out(fit.cameras.size());
    std::vector<Coverage> coverage;
    for (const Camera& camera : fit.cameras) coverage.emplace_back(camera.width, camera.height);
    std::vector<double> sum(out.size(), 0), held_sum(out.size(), 0);
    std::vector<int> count(out.size(), 0), last(out.size(), -1);
    for (std::size_t i = 0; i < fit.observations.size(); ++i) {
        const BundleObservation& o = fit.observations[i];
        coverage[o.camera].add(o.pixel);
        if (last[o.camera] != o.frame_set) ++out[o.camera].views;
        last[o.camera] = o.frame_set;
        if (!std::isfinite(fit_report.errors_px[i])) continue;
        sum[o.camera] += fit_report.errors_px[i] * fit_report.errors_px[i], ++count[o.camera];
    }
    std::vector<int> held_count(out.size(), 0);
    for (std::size_t i = 0; i < held_report.errors_px.size(); ++i) {
        const BundleObservation& o = held_out.observations[i];
        if (!std::isfinite(held_report.errors_px[i])) continue;
        held_sum[o.camera] += held_report.errors_px[i] * held_report.errors_px[i], ++held_count[o.camera];
    }
    for (std::size_t c = 0; c < out.size(); ++c) {
        out[c].fit_rms_px = count[c] ? std::sqrt(sum[c] / count[c]) : std::nan("");
        if (held_count[c]) out[c].held_out_rms_px = std::sqrt(held_sum[c] / held_count[c]);
        out[c].coverage = coverage[c].fraction();
        out[c].coverage_counts = coverage[c].counts();
        out[c].residuals = sample_residuals(held_count[c] ? held_out : fit, static_cast<int>(c));
    }
    return out;
}

void append_findings(const Bundle& bundle, TargetKind kind, ExtrinsicsResult& result) {
    const std::string target = kind == TargetKind::kBoard ? "board" : "wand";
    const double all_px = result.held_out_rms_px.value_or(result.fit_rms_px);
    if (all_px > kSuspiciousPx) explain_errors(bundle, target, result.findings);
    if (all_px > 1.0)
        result.findings.push_back(
            {all_px > 3 ? Verdict::kNoGo : Verdict::kCaution, "reprojection", "",
             fmt::format("the reprojection error of held-out views is {:.2f} px", all_px),
             kind == TargetKind::kBoard
                 ? "check the cameras named here; calibrate their intrinsics again, hold the board "
                   "still, use a flat stiff one"
                 : "check the cameras named here; calibrate their intrinsics again, move the wand more "
                   "slowly, cover other bright spots"});
    for (std::size_t c = 0; c < result.reprojections.size(); ++c)
        check_camera(bundle, target, static_cast<int>(c), all_px, result);
    if (const std::size_t frame_sets = bundle.world_from_target.size(); frame_sets < 10)
        result.findings.push_back(
            {frame_sets < 5 ? Verdict::kNoGo : Verdict::kCaution, "too_few_views", "",
             fmt::format("only {} frame sets in which two cameras detected the {}", frame_sets, target),
             fmt::format("move the {} for a minute through the whole space", target)});
    check_tilt(bundle, kind, result.findings);
    if (result.scale && std::abs(result.scale->bias_mm_per_m) > 5)
        result.findings.push_back(
            {Verdict::kCaution, "scale", "",
             fmt::format("measured lengths are {:.1f} mm per metre too {}",
                         std::abs(result.scale->bias_mm_per_m),
                         result.scale->bias_mm_per_m > 0 ? "long" : "short"),
             fmt::format("show the {} also near the centre of the space and closer to the cameras", target)});
}

}  // namespace kinevox
