#include "server/calibration/extrinsics_checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "common/degrees.h"
#include "server/calibration/coverage.h"
#include "server/calibration/triangulation.h"

namespace kinevox {
namespace {

constexpr double kSuspiciousPx = 0.7;   // held out: beyond it, what could be wrong is tried out
constexpr double kPoorCoverage = 0.26;  // part of the picture

// Every few moments only, so that suspicions are tried quickly.
Bundle some_moments(const Bundle& bundle, int most) {
    Bundle some = bundle;
    some.world_from_thing.clear(), some.observations.clear();
    const int all = static_cast<int>(bundle.world_from_thing.size()), step = std::max(1, all / most);
    std::vector<int> index(all, -1);
    for (int m = 0; m < all; m += step) {
        index[m] = static_cast<int>(some.world_from_thing.size());
        some.world_from_thing.push_back(bundle.world_from_thing[m]);
    }
    for (BundleObservation o : bundle.observations) {
        o.moment = index[o.moment];
        if (o.moment >= 0) some.observations.push_back(o);
    }
    return some;
}

// Root mean square error after a solve, outliers counted as 30 px.
double solved_px(Bundle& bundle) {
    BundleOptions options;
    options.max_iterations = 60;
    options.robust_px = 20;  // wide, so that a wrong start is left
    BundleReport report;
    if (!solve_bundle(bundle, options, report).ok()) return 1e9;
    double sum = 0;
    for (const double error : report.errors_px)
        sum += std::isfinite(error) ? std::min(error * error, 900.0) : 900.0;
    return std::sqrt(sum / static_cast<double>(report.errors_px.size()));
}

bool find_swapped(const Bundle& some, const std::string& thing, double before_px,
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
                {Verdict::kNoGo, "swapped", some.cameras[a].name,
                 fmt::format(
                     "cameras {} and {} look swapped: with each other's lenses the {} misses by {:.2f} px "
                     "instead of {:.2f}",
                     some.cameras[a].name, some.cameras[b].name, thing, after_px, before_px),
                 "exchange the two cameras' names or cables, then calibrate again"});
        }
    return found;
}

// A camera that two places, one before and one after some moment, fit much better than one.
void find_moved(const Bundle& some, const std::string& thing, double before_px,
                std::vector<Finding>& findings) {
    const int moments = static_cast<int>(some.world_from_thing.size());
    double best_px = 0.65 * before_px, turned = 0, moved = 0;
    int which = -1;
    for (std::size_t c = 0; c < some.cameras.size(); ++c)
        for (const double part : {0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8}) {
            Bundle split = some;
            split.cameras.push_back(some.cameras[c]);
            if (!split.delay.empty()) split.delay.push_back(split.delay[c]);
            for (BundleObservation& o : split.observations)
                if (o.camera == static_cast<int>(c) && o.moment >= part * moments)
                    o.camera = static_cast<int>(some.cameras.size());
            const double after_px = solved_px(split);
            if (after_px >= best_px) continue;
            best_px = after_px, which = static_cast<int>(c);
            const Camera &early = split.cameras[c], &late = split.cameras.back();
            turned =
                degrees(angle_between(early.camera_from_world.rotation, late.camera_from_world.rotation));
            moved = norm(early.centre_in_world() - late.centre_in_world());
        }
    if (which >= 0 && (turned > 0.1 || moved > 0.01))
        findings.push_back(
            {Verdict::kNoGo, "knocked", some.cameras[which].name,
             fmt::format("camera {} moved while the {} was shown, by {:.1f} degrees and {:.0f} mm",
                         some.cameras[which].name, thing, turned, 1000 * moved),
             "fix the camera firmly and calibrate again"});
}

// A camera without which the others fit.
void find_odd_one(const Bundle& some, const std::string& thing, double before_px,
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
        {Verdict::kNoGo, "odd_camera", name,
         fmt::format("camera {} does not fit the others: without it the {} misses by {:.2f} px instead of "
                     "{:.2f}",
                     name, thing, best_px, before_px),
         "look whether its picture is mirrored, its lens another one than it is calibrated for, its zoom or "
         "focus changed, or its video from another time"});
}

// Of one camera, evenly over its observations.
std::vector<PixelMiss> some_misses(const Bundle& bundle, int camera) {
    constexpr std::size_t kMost = 400;
    std::vector<PixelMiss> all;
    for (const BundleObservation& o : bundle.observations) {
        if (o.camera != camera) continue;
        const auto expected = bundle.cameras[camera].project(observed_point(bundle, o));
        if (expected) all.push_back({o.pixel, {o.pixel.x - expected->x, o.pixel.y - expected->y}});
    }
    std::vector<PixelMiss> some;
    const std::size_t used = std::min(kMost, all.size());
    for (std::size_t i = 0; i < used; ++i) some.push_back(all[i * all.size() / used]);
    return some;
}

}  // namespace

std::vector<Finding> check_views(const PosedViews& views) {
    std::vector<Finding> findings;
    int all = 0, behind = 0;
    for (const auto& [moment, seen] : views.all())
        for (const PosedView& view : seen) {
            ++all;
            behind += view.pose.tilt_rad > std::numbers::pi / 2;
        }
    if (all > 0 && 2 * behind > all)
        findings.push_back({Verdict::kNoGo, "mirrored", "",
                            "the board is mirrored: all cameras seem to see its print from behind, and a "
                            "floor taken from it "
                            "would be upside down",
                            "print the board unmirrored, or give its corners in the right order"});
    return findings;
}

std::optional<ScaleError> scale_error(const Bundle& bundle) {
    std::map<std::pair<int, int>, std::vector<Sight>> sights;
    for (const BundleObservation& o : bundle.observations)
        sights[{o.moment, o.point}].push_back({&bundle.cameras[o.camera], o.pixel});
    std::map<int, std::map<int, Vec3>> points;  // [moment][point]
    for (const auto& [key, seen] : sights)
        if (const auto point = triangulate(seen)) points[key.first][key.second] = *point;
    double sum = 0, squares = 0;
    int count = 0;
    for (const auto& [moment, placed] : points)
        for (auto a = placed.begin(); a != placed.end(); ++a)
            for (auto b = std::next(a); b != placed.end(); ++b) {
                const double truth =
                    norm(bundle.points_in_thing[a->first] - bundle.points_in_thing[b->first]);
                const double error = 1000 * (norm(a->second - b->second) - truth) / truth;
                sum += error, squares += error * error, ++count;
            }
    if (count < 10) return std::nullopt;
    const double mean = sum / count;
    return ScaleError{mean, std::sqrt(std::max(0.0, squares / count - mean * mean)), count};
}

std::vector<CameraQuality> camera_quality(const Bundle& fit, const BundleReport& fit_report,
                                          const Bundle& held_out, const BundleReport& held_report) {
    std::vector<CameraQuality> out(fit.cameras.size());
    std::vector<Coverage> coverage;
    for (const Camera& camera : fit.cameras) coverage.emplace_back(camera.width, camera.height);
    std::vector<double> sum(out.size(), 0), held_sum(out.size(), 0);
    std::vector<int> count(out.size(), 0), last(out.size(), -1);
    for (std::size_t i = 0; i < fit.observations.size(); ++i) {
        const BundleObservation& o = fit.observations[i];
        coverage[o.camera].add(o.pixel);
        if (last[o.camera] != o.moment) ++out[o.camera].views;
        last[o.camera] = o.moment;
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
        out[c].coverage = coverage[c].part();
        out[c].coverage_counts = coverage[c].counts();
        out[c].misses = some_misses(held_count[c] ? held_out : fit, static_cast<int>(c));
    }
    return out;
}

void append_findings(const Bundle& bundle, Shown shown, ExtrinsicsResult& result) {
    const std::string thing = shown == Shown::kBoard ? "board" : "wand";
    const auto add = [&](Verdict verdict, const char* check, const std::string& camera, std::string reason,
                         std::string remedy) {
        result.findings.push_back({verdict, check, camera, std::move(reason), std::move(remedy)});
    };
    const double all_px = result.held_out_rms_px.value_or(result.fit_rms_px);
    if (all_px > kSuspiciousPx) {
        Bundle some = some_moments(bundle, 40);
        const double before_px = solved_px(some);
        const std::size_t told = result.findings.size();
        if (!find_swapped(some, thing, before_px, result.findings))
            find_moved(some, thing, before_px, result.findings);
        if (result.findings.size() == told) find_odd_one(some, thing, before_px, result.findings);
    }
    const std::size_t moments = bundle.world_from_thing.size();
    if (all_px > 1.0)
        add(all_px > 3 ? Verdict::kNoGo : Verdict::kCare, "reprojection", "",
            fmt::format("views kept out of the fit miss by {:.2f} px", all_px),
            shown == Shown::kBoard
                ? "look at the cameras named here; calibrate their lenses anew, hold the board "
                  "still, use a flat stiff one"
                : "look at the cameras named here; calibrate their lenses anew, wave the wand more "
                  "slowly, cover other bright spots");
    for (std::size_t c = 0; c < result.quality.size(); ++c) {
        const CameraQuality& q = result.quality[c];
        const std::string& name = result.cameras[c].name;
        const double px = q.held_out_rms_px.value_or(q.fit_rms_px);
        if (px > std::max(0.8, 2.5 * all_px))
            add(px > 3 ? Verdict::kNoGo : Verdict::kCare, "camera_reprojection", name,
                fmt::format("camera {} misses by {:.2f} px, all together by {:.2f}", name, px, all_px),
                "check that it did not move, and calibrate its lens anew");
        if (q.views < 6)
            add(q.views < 4 ? Verdict::kNoGo : Verdict::kCare, "too_few_views", name,
                fmt::format("camera {} has only {} views of the {} together with others", name, q.views,
                            thing),
                fmt::format("show it the {} in ten or more places", thing));
        if (q.coverage < kPoorCoverage) {
            Coverage coverage(bundle.cameras[c].width, bundle.cameras[c].height);
            for (const BundleObservation& o : bundle.observations)
                if (o.camera == static_cast<int>(c)) coverage.add(o.pixel);
            add(Verdict::kCare, "coverage", name,
                fmt::format(
                    "camera {} is poorly covered: the {} was seen in {:.0f} % of its picture, {} is the "
                    "emptiest part",
                    name, thing, 100 * q.coverage, coverage.emptiest()),
                fmt::format("hold the {} also in {} of its picture", thing, coverage.emptiest()));
        }
    }
    if (moments < 10)
        add(moments < 5 ? Verdict::kNoGo : Verdict::kCare, "too_few_views", "",
            fmt::format("only {} moments in which two cameras saw the {}", moments, thing),
            fmt::format("move the {} for a minute through the whole space", thing));
    // A board that never turned: the scale along its normal is hardly known. A wand has a direction only.
    const int axis = shown == Shown::kBoard ? 2 : 0;
    double widest = 0;
    for (const Rigid3& a : bundle.world_from_thing) {
        const Mat3 &r = a.rotation, &first = bundle.world_from_thing.front().rotation;
        const double cosine =
            r(0, axis) * first(0, axis) + r(1, axis) * first(1, axis) + r(2, axis) * first(2, axis);
        // Which end of the wand is which does not matter.
        const double turned =
            degrees(std::acos(std::clamp(shown == Shown::kWand ? std::abs(cosine) : cosine, -1.0, 1.0)));
        widest = std::max(widest, turned);
    }
    if (widest < 12 && shown == Shown::kBoard)
        add(Verdict::kCare, "flat", "",
            fmt::format("the board was flat the same way in all views (tilted by at most {:.0f} degrees)",
                        widest),
            "tilt the board by 20 to 45 degrees, in several directions");
    else if (widest < 12)
        add(Verdict::kCare, "flat", "",
            fmt::format("the wand was held the same way all the time (turned by at most {:.0f} degrees)",
                        widest),
            "turn the wand every way while you wave it");
    if (result.scale && std::abs(result.scale->bias_mm_per_m) > 5)
        add(Verdict::kCare, "scale", "",
            fmt::format("lengths come out {:.1f} mm per metre too {}", std::abs(result.scale->bias_mm_per_m),
                        result.scale->bias_mm_per_m > 0 ? "long" : "short"),
            fmt::format("show the {} also near the middle of the space and closer to the cameras", thing));
}

}  // namespace kinevox
