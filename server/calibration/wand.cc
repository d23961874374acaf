#include "server/calibration/wand.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>

#include "common/one_line.h"
#include "server/calibration/extrinsics_checks.h"
#include "server/calibration/median.h"
#include "server/calibration/triangulation.h"

namespace kinevox {
namespace {

constexpr double kMaxMissPx = 8;     // views that miss by more, and by
constexpr double kMaxMissRatio = 6;  // so many times the median, are no view of the wand,
constexpr double kMaxStrays = 0.1;   // as long as they are fewer than this part of a camera's views

Rigid3 pose_between(Vec3 first, Vec3 last) {
    const Vec3 x = normalized(last - first);
    const Vec3 aside = std::abs(x.z) < 0.9 ? Vec3{0, 0, 1} : Vec3{1, 0, 0};
    const Vec3 y = normalized(cross(aside, x)), z = cross(x, y);
    return {{{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}}, first};
}

struct Bundles {
    Bundle fit, held_out;
    BundleReport report, held_report;
    std::vector<int> cameras, fit_moments, held_moments;  // indices of the lenses; the moments' numbers
};

Bundles bundles_of(const std::vector<Camera>& cameras, const std::vector<bool>& placed,
                   const std::vector<Vec3>& balls, const WandMoments& moments, int held_out_every) {
    Bundles out;
    std::vector<int> index(cameras.size(), -1);
    out.fit.points_in_thing = balls;
    for (std::size_t c = 0; c < cameras.size(); ++c)
        if (placed[c]) {
            index[c] = static_cast<int>(out.cameras.size());
            out.cameras.push_back(static_cast<int>(c));
            out.fit.cameras.push_back(cameras[c]);
        }
    out.held_out = out.fit;
    int joint = 0;
    for (const auto& [moment, views] : moments) {
        std::vector<Sight> first, last;
        for (const auto& [camera, seen] : views) {
            if (index[camera] < 0) continue;
            first.push_back({&out.fit.cameras[index[camera]], seen.front()});
            last.push_back({&out.fit.cameras[index[camera]], seen.back()});
        }
        const auto from = triangulate(first), to = triangulate(last);
        if (!from || !to) continue;
        const bool keep_out = held_out_every > 1 && joint++ % held_out_every == held_out_every - 1;
        Bundle& bundle = keep_out ? out.held_out : out.fit;
        const int m = static_cast<int>(bundle.world_from_thing.size());
        bundle.world_from_thing.push_back(pose_between(*from, *to));
        (keep_out ? out.held_moments : out.fit_moments).push_back(moment);
        for (const auto& [camera, seen] : views)
            for (std::size_t k = 0; k < balls.size() && index[camera] >= 0; ++k)
                bundle.observations.push_back({index[camera], m, static_cast<int>(k), seen[k], {}, {}});
    }
    return out;
}

// Takes views out of `moments` that miss by far, unless they are a large part of their camera's: then they
// tell something about the camera.
void drop_strays(const Bundle& bundle, const BundleReport& report, const std::vector<int>& cameras,
                 const std::vector<int>& numbers, WandMoments& moments) {
    std::vector<double> errors;
    for (const double error : report.errors_px)
        if (std::isfinite(error)) errors.push_back(error);
    if (errors.empty()) return;
    const double most = std::max(kMaxMissPx, kMaxMissRatio * median_of(errors));
    std::vector<std::set<int>> views(bundle.cameras.size()), strays(bundle.cameras.size());
    for (std::size_t i = 0; i < report.errors_px.size(); ++i) {
        const BundleObservation& o = bundle.observations[i];
        views[o.camera].insert(o.moment);
        if (!(report.errors_px[i] < most)) strays[o.camera].insert(o.moment);
    }
    for (std::size_t c = 0; c < views.size(); ++c)
        if (static_cast<double>(strays[c].size()) < kMaxStrays * static_cast<double>(views[c].size()))
            for (const int moment : strays[c]) moments[numbers[moment]].erase(cameras[c]);
}

}  // namespace

std::string WandSpec::check() const {
    if (!(length_m >= 0.05 && length_m <= 5))
        return fmt::format("the wand is {:g} mm long; 50 to 5000 are allowed", 1000 * length_m);
    if (middle_m == 0) return {};
    if (!(middle_m > 0 && middle_m < 0.42 * length_m))
        return fmt::format(
            "the wand's middle ball is at {:g} of {:g} mm; it must be clearly nearer to the first end",
            1000 * middle_m, 1000 * length_m);
    return {};
}

std::vector<Vec3> WandSpec::balls() const {
    if (middle_m == 0) return {{0, 0, 0}, {length_m, 0, 0}};
    return {{0, 0, 0}, {middle_m, 0, 0}, {length_m, 0, 0}};
}

absl::StatusOr<WandSpec> parse_wand(std::string_view text) {
    WandSpec wand;
    const auto read = [](std::string_view part, double& value) {
        const auto [end, code] = std::from_chars(part.data(), part.data() + part.size(), value);
        return code == std::errc{} && end == part.data() + part.size();
    };
    const std::string_view lengths = text.starts_with("wand:") ? text.substr(5) : std::string_view();
    const std::size_t colon = lengths.find(':');
    const bool three = colon != std::string_view::npos;
    wand.middle_m = 0;
    if (!(three ? read(lengths.substr(0, colon), wand.middle_m) && wand.middle_m > 0 &&
                      read(lengths.substr(colon + 1), wand.length_m)
                : read(lengths, wand.length_m)))
        return absl::InvalidArgumentError(one_line(
            fmt::format("wand '{}': write wand:200:600, mm from the first ball to the second and to the "
                        "third, or wand:600 for two balls",
                        text.substr(0, 60))));
    wand.middle_m /= 1000, wand.length_m /= 1000;
    if (const std::string problem = wand.check(); !problem.empty())
        return absl::InvalidArgumentError(problem);
    return wand;
}

WandProcedure::WandProcedure(std::vector<Camera> lenses, const WandSpec& wand,
                             const ExtrinsicsOptions& options)
    : lenses_(std::move(lenses)), wand_(wand), options_(options) {}

void WandProcedure::add_observation(int moment, int camera, const WandSighting& sighting) {
    if (sighting && sighting->size() == wand_.balls().size()) moments_[moment][camera] = *sighting;
}

std::vector<std::string> WandProcedure::hints() const {
    std::vector<int> seen(lenses_.size(), 0);
    for (const auto& [moment, views] : moments_)
        for (const auto& [camera, balls] : views) seen[camera] += views.size() > 1;
    std::vector<std::string> hints;
    for (std::size_t c = 0; c < lenses_.size(); ++c)
        if (seen[c] < kMinWandMoments)
            hints.push_back(fmt::format(
                "camera {} has seen the wand together with another camera {} times; {} are needed",
                lenses_[c].name, seen[c], kMinWandMoments));
    return hints;
}

absl::StatusOr<ExtrinsicsResult> WandProcedure::solve(const SolveProgress& progress) const {
    const absl::Status cancelled = absl::CancelledError("stopped; nothing was changed");
    if (progress && !progress(0.02, "pairs of cameras")) return cancelled;
    const std::vector<Vec3> balls = wand_.balls();
    const std::vector<CameraPair> joined = wand_pairs(lenses_, balls, moments_);
    if (joined.empty())
        return absl::FailedPreconditionError(fmt::format(
            "no two cameras have seen the whole wand together in {} moments or more; wave it {}for a "
            "minute where two or more see it",
            kMinWandMoments, balls.size() == 2 ? "slowly " : ""));
    const CameraTree tree = join_cameras(static_cast<int>(lenses_.size()), joined);
    ExtrinsicsResult result;
    std::vector<Camera> cameras = lenses_;
    std::vector<bool> placed(lenses_.size(), false);
    for (const int c : tree.groups.front())
        placed[c] = true, cameras[c].camera_from_world = tree.camera_from_world[c];
    for (std::size_t c = 0; c < lenses_.size(); ++c)
        if (!placed[c]) {
            result.left_out.push_back(lenses_[c].name);
            result.findings.push_back(
                {Verdict::kNoGo, "unconnected", lenses_[c].name,
                 fmt::format("camera {} shares too few views of the wand with the others", lenses_[c].name),
                 "wave the wand where it and another camera see it at the same time"});
        }
    // Once more with better places: the balls are told apart better, and what never was the wand shows.
    Bundles solved;
    WandMoments moments = moments_;
    for (int round = 0; round < 2; ++round) {
        if (balls.size() == 2) order_two_balls(cameras, placed, wand_.length_m, moments);
        solved = bundles_of(cameras, placed, balls, moments, options_.held_out_every);
        BundleOptions options;
        options.robust_px = options_.robust_px;
        options.threads = options_.threads;
        const SolveProgress within = [&](double part, const std::string& what) {
            return !progress || progress(0.1 + 0.4 * (round + part), what);
        };
        if (absl::Status status = solve_bundle(solved.fit, options, solved.report, within); !status.ok())
            return status;
        if (absl::Status status = place_held_out(solved.fit, options, solved.held_out, solved.held_report);
            !status.ok())
            return status;
        for (std::size_t i = 0; i < solved.cameras.size(); ++i)
            cameras[solved.cameras[i]] = solved.fit.cameras[i];
        if (round == 0) {
            drop_strays(solved.fit, solved.report, solved.cameras, solved.fit_moments, moments);
            drop_strays(solved.held_out, solved.held_report, solved.cameras, solved.held_moments, moments);
        }
    }
    const Bundle &fit = solved.fit, &held_out = solved.held_out;
    result.cameras = fit.cameras;
    result.fit_rms_px = solved.report.rms_px;
    if (!held_out.observations.empty()) {
        result.held_out_rms_px = solved.held_report.rms_px;
        result.scale = scale_error(held_out);
    }
    result.quality = camera_quality(fit, solved.report, held_out, solved.held_report);
    for (const BundleObservation& o : fit.observations) result.seen_points.push_back(observed_point(fit, o));
    append_findings(fit, Shown::kWand, result);
    if (progress && !progress(1, "done")) return cancelled;
    return result;
}

}  // namespace kinevox
