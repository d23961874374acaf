#include "server/calibration/wand/wand.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>

#include "common/median.h"
#include "common/one_line.h"
#include "server/calibration/board/extrinsics.h"
#include "server/calibration/multi_view.h"

namespace kinevox {
namespace {

constexpr double kMaxResidualPx = 8;     // views with a larger error, and
constexpr double kMaxResidualRatio = 6;  // more than this multiple of the median error, are not the wand,
constexpr double kMaxStrays = 0.1;       // if they are less than this fraction of a camera's views

Rigid3 pose_between(Vec3 first, Vec3 last) {
    const Vec3 x = normalized(last - first);
    const Vec3 helper = std::abs(x.z) < 0.9 ? Vec3{0, 0, 1} : Vec3{1, 0, 0};
    const Vec3 y = normalized(cross(helper, x)), z = cross(x, y);
    return {{{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}}, first};
}

struct Bundles {
    Bundle fit, held_out;
    BundleReport report, held_report;
    std::vector<int> cameras, fit_frame_sets,
        held_frame_sets;  // indices of the cameras; numbers of the frame sets
};

Bundles bundles_of(const std::vector<Camera>& cameras, const std::vector<bool>& has_pose,
                   const std::vector<Vec3>& balls, const WandFrameSets& frame_sets, int held_out_every) {
    Bundles out;
    std::vector<int> index(cameras.size(), -1);
    out.fit.points_in_target = balls;
    for (std::size_t c = 0; c < cameras.size(); ++c)
        if (has_pose[c]) {
            index[c] = static_cast<int>(out.cameras.size());
            out.cameras.push_back(static_cast<int>(c));
            out.fit.cameras.push_back(cameras[c]);
        }
    out.held_out = out.fit;
    int joint = 0;
    for (const auto& [frame_set, views] : frame_sets) {
        std::vector<Observation> first, last;
        for (const auto& [camera, seen] : views) {
            if (index[camera] < 0) continue;
            first.push_back({&out.fit.cameras[index[camera]], seen.front()});
            last.push_back({&out.fit.cameras[index[camera]], seen.back()});
        }
        const auto from = triangulate(first), to = triangulate(last);
        if (!from || !to) continue;
        const bool keep_out = held_out_every > 1 && joint++ % held_out_every == held_out_every - 1;
        Bundle& bundle = keep_out ? out.held_out : out.fit;
        const int m = static_cast<int>(bundle.world_from_target.size());
        bundle.world_from_target.push_back(pose_between(*from, *to));
        (keep_out ? out.held_frame_sets : out.fit_frame_sets).push_back(frame_set);
        for (const auto& [camera, seen] : views)
            for (std::size_t k = 0; k < balls.size() && index[camera] >= 0; ++k)
                bundle.observations.push_back({index[camera], m, static_cast<int>(k), seen[k], {}, {}});
    }
    return out;
}

// Removes views with large errors from `frame_sets`, unless they are a large fraction of their camera's: then
// the camera is at fault.
void drop_strays(const Bundle& bundle, const BundleReport& report, const std::vector<int>& cameras,
                 const std::vector<int>& numbers, WandFrameSets& frame_sets) {
    std::vector<double> errors;
    for (const double error : report.errors_px)
        if (std::isfinite(error)) errors.push_back(error);
    if (errors.empty()) return;
    const double most = std::max(kMaxResidualPx, kMaxResidualRatio * median_of(errors));
    std::vector<std::set<int>> views(bundle.cameras.size()), strays(bundle.cameras.size());
    for (std::size_t i = 0; i < report.errors_px.size(); ++i) {
        const BundleObservation& o = bundle.observations[i];
        views[o.camera].insert(o.frame_set);
        if (!(report.errors_px[i] < most)) strays[o.camera].insert(o.frame_set);
    }
    for (std::size_t c = 0; c < views.size(); ++c)
        if (static_cast<double>(strays[c].size()) < kMaxStrays * static_cast<double>(views[c].size()))
            for (const int frame_set : strays[c]) frame_sets[numbers[frame_set]].erase(cameras[c]);
}

}  // namespace

std::string WandSpec::check() const {
    if (!(length_m >= 0.05 && length_m <= 5))
        return fmt::format("the wand is {:g} mm long; 50 to 5000 are allowed", 1000 * length_m);
    if (middle_m == 0) return {};
    if (!(middle_m > 0 && middle_m < 0.42 * length_m))
        return fmt::format(
            "the wand's second ball is at {:g} of {:g} mm; it must be clearly closer to the first one",
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

WandProcedure::WandProcedure(std::vector<Camera> intrinsics, const WandSpec& wand,
                             const ExtrinsicsOptions& options)
    : intrinsics_(std::move(intrinsics)), wand_(wand), options_(options) {}

void WandProcedure::add_observation(int frame_set, int camera, const WandDetection& detection) {
    if (detection && detection->size() == wand_.balls().size()) frame_sets_[frame_set][camera] = *detection;
}

std::vector<std::string> WandProcedure::hints() const {
    std::vector<int> seen(intrinsics_.size(), 0);
    for (const auto& [frame_set, views] : frame_sets_)
        for (const auto& [camera, balls] : views) seen[camera] += views.size() > 1;
    std::vector<std::string> hints;
    for (std::size_t c = 0; c < intrinsics_.size(); ++c)
        if (seen[c] < kMinWandFrameSets)
            hints.push_back(
                fmt::format("camera {} shares {} views of the wand with other cameras; {} are needed",
                            intrinsics_[c].name, seen[c], kMinWandFrameSets));
    return hints;
}

absl::StatusOr<ExtrinsicsResult> WandProcedure::solve(const SolveProgress& progress) const {
    const absl::Status cancelled = absl::CancelledError("stopped; nothing was changed");
    if (progress && !progress(0.02, "pairs of cameras")) return cancelled;
    const std::vector<Vec3> balls = wand_.balls();
    const std::vector<CameraPair> joined = wand_pairs(intrinsics_, balls, frame_sets_);
    if (joined.empty())
        return absl::FailedPreconditionError(fmt::format(
            "no two cameras detected the whole wand in {} or more shared frame sets; move it {}for a "
            "minute where two or more see it",
            kMinWandFrameSets, balls.size() == 2 ? "slowly " : ""));
    const CameraTree tree = join_cameras(static_cast<int>(intrinsics_.size()), joined);
    ExtrinsicsResult result;
    std::vector<Camera> cameras = intrinsics_;
    std::vector<bool> has_pose(intrinsics_.size(), false);
    for (const int c : tree.groups.front())
        has_pose[c] = true, cameras[c].camera_from_world = tree.camera_from_world[c];
    for (std::size_t c = 0; c < intrinsics_.size(); ++c)
        if (!has_pose[c]) {
            result.excluded_cameras.push_back(intrinsics_[c].name);
            result.findings.push_back(
                {Verdict::kNoGo, "unconnected_camera", intrinsics_[c].name,
                 fmt::format("camera {} shares too few views of the wand with the others",
                             intrinsics_[c].name),
                 "move the wand where it and another camera see it at the same time"});
        }
    // Twice: with better poses the balls are ordered better, and false detections show.
    Bundles solved;
    WandFrameSets frame_sets = frame_sets_;
    for (int round = 0; round < 2; ++round) {
        if (balls.size() == 2) order_two_balls(cameras, has_pose, wand_.length_m, frame_sets);
        solved = bundles_of(cameras, has_pose, balls, frame_sets, options_.held_out_every);
        BundleOptions options;
        options.robust_px = options_.robust_px;
        options.threads = options_.threads;
        const SolveProgress within = [&](double fraction, const std::string& what) {
            return !progress || progress(0.1 + 0.4 * (round + fraction), what);
        };
        if (absl::Status status = solve_bundle(solved.fit, options, solved.report, within); !status.ok())
            return status;
        if (absl::Status status =
                solve_held_out_poses(solved.fit, options, solved.held_out, solved.held_report);
            !status.ok())
            return status;
        for (std::size_t i = 0; i < solved.cameras.size(); ++i)
            cameras[solved.cameras[i]] = solved.fit.cameras[i];
        if (round == 0) {
            drop_strays(solved.fit, solved.report, solved.cameras, solved.fit_frame_sets, frame_sets);
            drop_strays(solved.held_out, solved.held_report, solved.cameras, solved.held_frame_sets,
                        frame_sets);
        }
    }
    const Bundle &fit = solved.fit, &held_out = solved.held_out;
    result.cameras = fit.cameras;
    result.fit_rms_px = solved.report.rms_px;
    if (!held_out.observations.empty()) {
        result.held_out_rms_px = solved.held_report.rms_px;
        result.scale = scale_error(held_out);
    }
    result.reprojections = camera_reprojections(fit, solved.report, held_out, solved.held_report);
    for (const BundleObservation& o : fit.observations)
        result.target_points.push_back(observed_point(fit, o));
    append_findings(fit, TargetKind::kWand, result);
    if (progress && !progress(1, "done")) return cancelled;
    return result;
}

}  // namespace kinevox
