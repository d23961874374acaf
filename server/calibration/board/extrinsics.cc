
#include "server/calibration/board/extrinsics.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "server/calibration/board/posed_views.h"
#include "server/calibration/coverage.h"
#include "server/calibration/multi_view.h"

namespace kinevox {
namespace {

constexpr int kEnoughShared = 10;  // frame sets that a pair of cameras should share

// Velocity of each observed point from the board's poses in the adjacent frame sets.
void set_velocities(const std::vector<int>& fit_frame_sets, const std::vector<int>& held_frame_sets,
                    Bundle& fit, Bundle& held_out) {
    std::map<int, Rigid3> poses;
    for (std::size_t m = 0; m < fit_frame_sets.size(); ++m)
        poses[fit_frame_sets[m]] = fit.world_from_target[m];
    for (std::size_t m = 0; m < held_frame_sets.size(); ++m)
        poses[held_frame_sets[m]] = held_out.world_from_target[m];
    const auto set = [&](const std::vector<int>& frame_sets, Bundle& bundle) {
        for (BundleObservation& o : bundle.observations) {
            const auto at = poses.find(frame_sets[o.frame_set]);
            const auto before = poses.find(at->first - 1), after = poses.find(at->first + 1);
            const bool has_before = before != poses.end(), has_after = after != poses.end();
            o.velocity_in_world = o.acceleration_in_world = {};
            if (!has_before && !has_after) continue;
            const Vec3 point = bundle.points_in_target[o.point];
            const Vec3 from = (has_before ? before : at)->second * point,
                       to = (has_after ? after : at)->second * point;
            o.velocity_in_world = (to - from) / (has_before && has_after ? 2.0 : 1.0);
            if (has_before && has_after) o.acceleration_in_world = to + from - 2 * (at->second * point);
        }
    };
    set(fit_frame_sets, fit);
    set(held_frame_sets, held_out);
}

// Excludes views that the camera's delay and its jitter shift far: the pose of a moving board is known at the
// frame sets only. Each camera keeps its stillest views in any case.
void drop_moving(double max_px, Bundle& fit, Bundle& held_out) {
    constexpr double kJitter = 0.1;  // of the frame interval
    constexpr std::size_t kStillest = 10;
    double max_delay = 0;
    for (const double delay : fit.delay) max_delay = std::max(max_delay, std::abs(delay));
    if (max_delay < 0.03) return;  // synchronised cameras
    for (Bundle* bundle : {&fit, &held_out}) {
        std::map<std::pair<int, int>, double> shift_px;  // [camera, frame set]: the largest
        for (const BundleObservation& o : bundle->observations) {
            const Vec3 point = bundle->world_from_target[o.frame_set] * bundle->points_in_target[o.point];
            const double time = kJitter + std::abs(fit.delay[o.camera]);
            const auto here = fit.cameras[o.camera].project(point);
            const auto there = fit.cameras[o.camera].project(point + time * o.velocity_in_world);
            const double px = here && there ? std::hypot(here->x - there->x, here->y - there->y) : 1e6;
            double& most = shift_px[{o.camera, o.frame_set}];
            most = std::max(most, px);
        }
        std::vector<double> limit(fit.cameras.size(), max_px);
        for (std::size_t c = 0; c < limit.size(); ++c) {
            std::vector<double> own;
            for (const auto& [key, px] : shift_px)
                if (key.first == static_cast<int>(c)) own.push_back(px);
            std::sort(own.begin(), own.end());
            const std::size_t kept = bundle == &fit ? kStillest : kStillest / 4;
            if (!own.empty()) limit[c] = std::max(limit[c], own[std::min(kept, own.size()) - 1]);
        }
        std::erase_if(bundle->observations, [&](const BundleObservation& o) {
            return shift_px[{o.camera, o.frame_set}] > limit[o.camera];
        });
    }
}

// The bundle to fit and the held-out one. `solved_index`: of each camera among the connected ones, else -1.
struct SplitBundle {
    Bundle fit, held_out;
    BundleReport report, held_report;
    std::vector<int> solved_index, fit_frame_sets, held_frame_sets;
};

// Frame sets that two or more cameras of the largest group share; some are held out.
SplitBundle split_views(const PosedViews& views, const CameraTree& tree, int held_out_every) {
    const std::vector<Camera>& intrinsics = views.intrinsics();
    SplitBundle out;
    out.solved_index.assign(intrinsics.size(), -1);
    out.fit.points_in_target = views.points();
    for (const int c : tree.groups.front()) {
        out.solved_index[c] = static_cast<int>(out.fit.cameras.size());
        out.fit.cameras.push_back(intrinsics[c]);
        out.fit.cameras.back().camera_from_world = tree.camera_from_world[c];
    }
    out.held_out = out.fit;
    int joint = 0;
    for (const int frame_set : views.frame_sets()) {
        const std::vector<PosedView> seen = views.at(frame_set, out.solved_index);
        if (seen.size() < 2) continue;
        const bool keep_out = held_out_every > 1 && joint++ % held_out_every == held_out_every - 1;
        Bundle& to = keep_out ? out.held_out : out.fit;
        const int m = static_cast<int>(to.world_from_target.size());
        to.world_from_target.push_back(
            best_world_from_board(out.fit.cameras, seen, out.fit.points_in_target));
        for (const PosedView& view : seen)
            for (const Corner& corner : view.corners)
                to.observations.push_back({view.camera, m, corner.id, corner.pixel});
        (keep_out ? out.held_frame_sets : out.fit_frame_sets).push_back(frame_set);
    }
    return out;
}

// First as if all cameras were synchronised; then, with the board's velocity known, with a delay per camera.
absl::Status solve_split(const ExtrinsicsOptions& from, const SolveProgress& progress, SplitBundle& split) {
    BundleOptions options;
    options.robust_px = from.robust_px;
    options.free_intrinsics = from.refine_intrinsics;
    options.threads = from.threads;
    const int rounds = from.solve_delays ? 4 : 1;
    for (int round = 0; round < rounds; ++round) {
        const SolveProgress within = [&](double fraction, const std::string& what) {
            return !progress || progress(0.1 + 0.8 * (round + fraction) / rounds, what);
        };
        options.free_delays = round > 0;
        if (absl::Status status = solve_bundle(split.fit, options, split.report, within); !status.ok())
            return status;
        if (absl::Status status = solve_held_out_poses(split.fit, options, split.held_out, split.held_report);
            !status.ok())
            return status;
        if (round + 1 < rounds && round > 0) drop_moving(from.max_shift_px, split.fit, split.held_out);
        if (round + 1 < rounds)
            set_velocities(split.fit_frame_sets, split.held_frame_sets, split.fit, split.held_out);
    }
    return absl::OkStatus();
}

// Everything but the findings.
ExtrinsicsResult result_of(const PosedViews& views, const SplitBundle& split) {
    ExtrinsicsResult result;
    for (std::size_t c = 0; c < split.solved_index.size(); ++c)
        if (split.solved_index[c] < 0) result.excluded_cameras.push_back(views.intrinsics()[c].name);
    result.cameras = split.fit.cameras;
    result.fit_rms_px = split.report.rms_px;
    result.delays = split.fit.delay;
    if (!split.held_frame_sets.empty()) {
        result.held_out_rms_px = split.held_report.rms_px;
        result.scale = scale_error(split.held_out);
    }
    result.reprojections = camera_reprojections(split.fit, split.report, split.held_out, split.held_report);
    for (std::size_t m = 0; m < split.fit_frame_sets.size(); ++m)
        result.world_from_board[split.fit_frame_sets[m]] = split.fit.world_from_target[m];
    for (std::size_t m = 0; m < split.held_frame_sets.size(); ++m)
        result.world_from_board[split.held_frame_sets[m]] = split.held_out.world_from_target[m];
    for (const auto& [frame_set, world_from_board] : result.world_from_board)
        for (const PosedView& view : views.at(frame_set, split.solved_index))
            for (const Corner& corner : view.corners)
                result.target_points.push_back(world_from_board * split.fit.points_in_target[corner.id]);
    return result;
}

}  // namespace

ExtrinsicsProcedure::ExtrinsicsProcedure(std::vector<Camera> intrinsics, const BoardSpec& board,
                                         const ExtrinsicsOptions& options)
    : intrinsics_(std::move(intrinsics)),
      board_(board),
      options_(options),
      mirrored_(intrinsics_.size(), 0),
      blurred_(intrinsics_.size(), 0) {}

void ExtrinsicsProcedure::add_observation(int frame_set, int camera, const BoardDetection& detection) {
    if (detection.mirrored_image) ++mirrored_[camera];
    if (!detection.found()) return;
    if (detection.edge_px > options_.max_edge_px) {
        ++blurred_[camera];
        return;
    }
    frame_sets_[frame_set].push_back({camera, detection.corners});
}

std::vector<std::string> ExtrinsicsProcedure::hints() const {
    std::vector<std::string> hints;
    const int count = static_cast<int>(intrinsics_.size());
    std::vector<int> seen(count, 0);
    std::vector<CameraPair> pairs;
    std::map<std::pair<int, int>, int> shared;
    for (const auto& [frame_set, views] : frame_sets_)
        for (const View& a : views) {
            ++seen[a.camera];
            for (const View& b : views)
                if (a.camera < b.camera) ++shared[{a.camera, b.camera}];
        }
    for (const auto& [pair, votes] : shared)
        if (votes >= kEnoughShared) pairs.push_back({pair.first, pair.second, {}, votes});
    for (int c = 0; c < count; ++c) {
        if (seen[c] > 0) continue;
        hints.push_back(
            mirrored_[c] > 0 ? fmt::format("camera {} delivers a mirror image: switch its mirroring off",
                                           intrinsics_[c].name)
            : blurred_[c] > 0
                ? fmt::format("camera {} detects the board blurred: hold it still", intrinsics_[c].name)
                : fmt::format("camera {} has not detected the board", intrinsics_[c].name));
    }
    const CameraTree tree = join_cameras(count, pairs);
    for (std::size_t g = 1; g < tree.groups.size(); ++g) {
        const int c = tree.groups[g].front();
        if (seen[c] > 0)
            hints.push_back(
                fmt::format("camera {} shares too few views of the board with other cameras: hold it "
                            "where both see it",
                            intrinsics_[c].name));
    }
    return hints;
}

bool ExtrinsicsProcedure::complete() const {
    return !frame_sets_.empty() && hints().empty();
}

absl::StatusOr<ExtrinsicsResult> ExtrinsicsProcedure::solve(const SolveProgress& progress) const {
    const absl::Status cancelled = absl::CancelledError("stopped; nothing was changed");
    if (!board_.has_direction())
        return absl::FailedPreconditionError(fmt::format(
            "a checkerboard of {} x {} inner corners is symmetric under half a turn, so that "
            "cameras cannot be matched by it; use one with an odd and an even number, or a ChArUco board",
            board_.columns, board_.rows));
    const int count = static_cast<int>(intrinsics_.size());
    if (progress && !progress(0.02, "board pose per camera")) return cancelled;

    PosedViews views(intrinsics_, board_.points());
    for (const auto& [frame_set, seen] : frame_sets_)
        for (const View& view : seen) views.add(frame_set, view.camera, view.corners);
    views.thin(options_.max_frame_sets);
    const std::vector<Finding> view_findings = check_views(views);
    views.drop_misfits(options_.max_view_rms_px);

    const std::vector<CameraPair> pairs = views.pairs();
    if (pairs.empty()) {
        std::string why = hints().empty() ? "" : ": " + hints().front();
        for (const Finding& finding : view_findings) why = ": " + finding.reason;
        return absl::FailedPreconditionError(fmt::format(
            "no two cameras detected the board at the same time{}; move it where two or more see it", why));
    }
    if (progress && !progress(0.1, "joining the cameras")) return cancelled;
    SplitBundle split = split_views(views, join_cameras(count, pairs), options_.held_out_every);
    if (split.fit_frame_sets.size() < 3)
        return absl::FailedPreconditionError(
            fmt::format("too few views: two or more cameras detected the board in {} frame sets; at least 3 "
                        "are needed and 30 are good",
                        split.fit_frame_sets.size()));
    if (absl::Status solved = solve_split(options_, progress, split); !solved.ok()) return solved;

    ExtrinsicsResult result = result_of(views, split);
    result.findings = view_findings;
    std::vector<std::string> names;
    for (const Camera& camera : result.cameras) names.push_back(camera.name);
    for (const std::string& name : result.excluded_cameras)
        result.findings.push_back(
            {Verdict::kNoGo, "unconnected_camera", name,
             fmt::format("camera {} shares no view of the board with {}", name, fmt::join(names, ", ")),
             "move the board where it and another camera see it at the same time"});
    append_findings(split.fit, TargetKind::kBoard, result);
    if (progress && !progress(1, "done")) return cancelled;
    return result;
}

}  // namespace kinevox
