#include "server/calibration/extrinsics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/calibration/board_pose.h"
#include "server/calibration/camera_tree.h"
#include "server/calibration/coverage.h"
#include "server/calibration/extrinsics_checks.h"
#include "server/calibration/posed_views.h"
#include "server/calibration/triangulation.h"

namespace kinevox {
namespace {

constexpr int kEnoughTogether = 10;  // moments that a pair of cameras should share

std::string listed(const std::vector<std::string>& names) {
    return fmt::format("{}", fmt::join(names, ", "));
}

// Each observed point's velocity from the board's poses at the moments before and after.
void set_velocities(const std::vector<int>& fit_moments, const std::vector<int>& held_moments, Bundle& fit,
                    Bundle& held_out) {
    std::map<int, Rigid3> poses;
    for (std::size_t m = 0; m < fit_moments.size(); ++m) poses[fit_moments[m]] = fit.world_from_thing[m];
    for (std::size_t m = 0; m < held_moments.size(); ++m)
        poses[held_moments[m]] = held_out.world_from_thing[m];
    const auto set = [&](const std::vector<int>& moments, Bundle& bundle) {
        for (BundleObservation& o : bundle.observations) {
            const auto at = poses.find(moments[o.moment]);
            const auto before = poses.find(at->first - 1), after = poses.find(at->first + 1);
            const bool has_before = before != poses.end(), has_after = after != poses.end();
            o.velocity_in_world = o.acceleration_in_world = {};
            if (!has_before && !has_after) continue;
            const Vec3 point = bundle.points_in_thing[o.point];
            const Vec3 from = (has_before ? before : at)->second * point,
                       to = (has_after ? after : at)->second * point;
            o.velocity_in_world = (to - from) / (has_before && has_after ? 2.0 : 1.0);
            if (has_before && has_after) o.acceleration_in_world = to + from - 2 * (at->second * point);
        }
    };
    set(fit_moments, fit);
    set(held_moments, held_out);
}

// Leaves out views that their camera's delay, and the jitter that such cameras have, shifts far: a moving
// board is known at its moments only. Each camera keeps its stillest ones all the same.
void drop_moving(double max_px, Bundle& fit, Bundle& held_out) {
    constexpr double kJitter = 0.1;  // of the time between two moments
    constexpr std::size_t kStillest = 10;
    double longest = 0;
    for (const double delay : fit.delay) longest = std::max(longest, std::abs(delay));
    if (longest < 0.03) return;  // cameras that are triggered together
    for (Bundle* bundle : {&fit, &held_out}) {
        std::map<std::pair<int, int>, double> shift_px;  // [camera, moment]: the largest
        for (const BundleObservation& o : bundle->observations) {
            const Vec3 point = bundle->world_from_thing[o.moment] * bundle->points_in_thing[o.point];
            const double time = kJitter + std::abs(fit.delay[o.camera]);
            const auto here = fit.cameras[o.camera].project(point);
            const auto there = fit.cameras[o.camera].project(point + time * o.velocity_in_world);
            const double px = here && there ? std::hypot(here->x - there->x, here->y - there->y) : 1e6;
            double& most = shift_px[{o.camera, o.moment}];
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
            return shift_px[{o.camera, o.moment}] > limit[o.camera];
        });
    }
}

}  // namespace

ExtrinsicsProcedure::ExtrinsicsProcedure(std::vector<Camera> lenses, const BoardSpec& board,
                                         const ExtrinsicsOptions& options)
    : lenses_(std::move(lenses)),
      board_(board),
      options_(options),
      mirrored_(lenses_.size(), 0),
      blurred_(lenses_.size(), 0) {}

void ExtrinsicsProcedure::add_observation(int moment, int camera, const BoardSighting& sighting) {
    if (sighting.mirrored_picture) ++mirrored_[camera];
    if (!sighting.found()) return;
    if (sighting.edge_px > options_.max_edge_px) {
        ++blurred_[camera];
        return;
    }
    moments_[moment].push_back({camera, sighting.corners});
}

std::vector<std::string> ExtrinsicsProcedure::hints() const {
    std::vector<std::string> hints;
    const int count = static_cast<int>(lenses_.size());
    std::vector<int> seen(count, 0);
    std::vector<CameraPair> pairs;
    std::map<std::pair<int, int>, int> together;
    for (const auto& [moment, views] : moments_)
        for (const View& a : views) {
            ++seen[a.camera];
            for (const View& b : views)
                if (a.camera < b.camera) ++together[{a.camera, b.camera}];
        }
    for (const auto& [pair, votes] : together)
        if (votes >= kEnoughTogether) pairs.push_back({pair.first, pair.second, {}, votes});
    for (int c = 0; c < count; ++c) {
        if (seen[c] > 0) continue;
        hints.push_back(
            mirrored_[c] > 0
                ? fmt::format("camera {} delivers a mirror image: switch its mirroring off", lenses_[c].name)
            : blurred_[c] > 0
                ? fmt::format("camera {} sees the board blurred: hold it still", lenses_[c].name)
                : fmt::format("camera {} has not seen the board", lenses_[c].name));
    }
    const CameraTree tree = join_cameras(count, pairs);
    for (std::size_t g = 1; g < tree.groups.size(); ++g) {
        const int c = tree.groups[g].front();
        if (seen[c] > 0)
            hints.push_back(
                fmt::format("camera {} has seen the board together with another camera too seldom: hold it "
                            "where both see it",
                            lenses_[c].name));
    }
    return hints;
}

bool ExtrinsicsProcedure::complete() const {
    return !moments_.empty() && hints().empty();
}

absl::StatusOr<ExtrinsicsResult> ExtrinsicsProcedure::solve(const SolveProgress& progress) const {
    const absl::Status cancelled = absl::CancelledError("stopped; nothing was changed");
    if (!board_.has_direction())
        return absl::FailedPreconditionError(
            fmt::format("a checkerboard of {} x {} inner corners looks the same after half a turn, so that "
                        "cameras cannot be matched by "
                        "it; use one with an odd and an even number, or a ChArUco board",
                        board_.columns, board_.rows));
    const int count = static_cast<int>(lenses_.size());
    if (progress && !progress(0.02, "the board's place before each camera")) return cancelled;

    PosedViews views(lenses_, board_.points());
    for (const auto& [moment, seen] : moments_)
        for (const View& view : seen) views.add(moment, view.camera, view.corners);
    views.thin(options_.max_moments);
    const std::vector<Finding> found_early = check_views(views);
    views.drop_misfits(options_.max_view_rms_px);

    const std::vector<CameraPair> pairs = views.pairs();
    if (pairs.empty()) {
        std::string why = hints().empty() ? "" : ": " + hints().front();
        for (const Finding& finding : found_early) why = ": " + finding.reason;
        return absl::FailedPreconditionError(fmt::format(
            "no two cameras have seen the board at the same time{}; move it where two or more see it", why));
    }
    if (progress && !progress(0.1, "cameras joined by what they saw together")) return cancelled;
    const CameraTree tree = join_cameras(count, pairs);

    ExtrinsicsResult result;
    std::vector<int> solved_index(count, -1);
    Bundle bundle;
    bundle.points_in_thing = board_.points();
    for (const int c : tree.groups.front()) {
        solved_index[c] = static_cast<int>(bundle.cameras.size());
        bundle.cameras.push_back(lenses_[c]);
        bundle.cameras.back().camera_from_world = tree.camera_from_world[c];
    }
    for (int c = 0; c < count; ++c)
        if (solved_index[c] < 0) result.left_out.push_back(lenses_[c].name);

    // Moments that two or more of these cameras saw; some are kept out.
    Bundle held_out = bundle;  // its poses are those of the moments kept out
    std::vector<int> fit_moments, held_moments;
    int joint = 0;
    for (const int moment : views.moments()) {
        const std::vector<PosedView> seen = views.at(moment, solved_index);
        if (seen.size() < 2) continue;
        const bool keep_out =
            options_.held_out_every > 1 && joint++ % options_.held_out_every == options_.held_out_every - 1;
        Bundle& to = keep_out ? held_out : bundle;
        const int m = static_cast<int>(to.world_from_thing.size());
        to.world_from_thing.push_back(best_world_from_board(bundle.cameras, seen, bundle.points_in_thing));
        for (const PosedView& view : seen)
            for (const Corner& corner : view.corners)
                to.observations.push_back({view.camera, m, corner.id, corner.pixel});
        (keep_out ? held_moments : fit_moments).push_back(moment);
    }
    if (fit_moments.size() < 3)
        return absl::FailedPreconditionError(
            fmt::format("too few views: two or more cameras saw the board together in {} moments; at least 3 "
                        "are needed and 30 are good",
                        fit_moments.size()));

    BundleOptions options;
    options.robust_px = options_.robust_px;
    options.free_intrinsics = options_.refine_lenses;
    options.threads = options_.threads;
    BundleReport report, held_report;
    // First as if all pictures were taken at once; then, with the board's speed known, each camera's delay.
    const int rounds = options_.solve_delays ? 4 : 1;
    for (int round = 0; round < rounds; ++round) {
        const SolveProgress within = [&](double part, const std::string& what) {
            return !progress || progress(0.1 + 0.8 * (round + part) / rounds, what);
        };
        options.free_delays = round > 0;
        if (absl::Status status = solve_bundle(bundle, options, report, within); !status.ok()) return status;
        if (absl::Status status = place_held_out(bundle, options, held_out, held_report); !status.ok())
            return status;
        if (round + 1 < rounds && round > 0) drop_moving(options_.max_shift_px, bundle, held_out);
        if (round + 1 < rounds) set_velocities(fit_moments, held_moments, bundle, held_out);
    }
    result.cameras = bundle.cameras;
    result.fit_rms_px = report.rms_px;
    result.delays = bundle.delay;
    if (!held_moments.empty()) {
        result.held_out_rms_px = held_report.rms_px;
        result.scale = scale_error(held_out);
    }
    result.quality = camera_quality(bundle, report, held_out, held_report);
    for (std::size_t m = 0; m < fit_moments.size(); ++m)
        result.world_from_board[fit_moments[m]] = bundle.world_from_thing[m];
    for (std::size_t m = 0; m < held_moments.size(); ++m)
        result.world_from_board[held_moments[m]] = held_out.world_from_thing[m];
    for (const auto& [moment, world_from_board] : result.world_from_board)
        for (const PosedView& view : views.at(moment, solved_index))
            for (const Corner& corner : view.corners)
                result.seen_points.push_back(world_from_board * bundle.points_in_thing[corner.id]);

    result.findings = found_early;
    for (const std::string& name : result.left_out)
        result.findings.push_back(
            {Verdict::kNoGo, "unconnected", name,
             fmt::format("camera {} shares no view of the board with {}", name, listed([&] {
                             std::vector<std::string> names;
                             for (const Camera& camera : result.cameras) names.push_back(camera.name);
                             return names;
                         }())),
             "move the board where it and another camera see it at the same time"});
    append_findings(bundle, Shown::kBoard, result);
    if (progress && !progress(1, "done")) return cancelled;
    return result;
}

}  // namespace kinevox
