#include "server/pose/retrack.h"

#include <oneapi/tbb/parallel_invoke.h>

#include <algorithm>
#include <array>
#include <limits>

namespace kinevox {
namespace {

// Scale of the cost for a jump of the joints over a reference interval or less.
constexpr double kJumpStd_m = 0.04;

struct Pass {
    std::vector<RetrackedFrame> frames;
    std::vector<double> cost;
    std::vector<std::array<Vec3, kJointNames.size()>> joints;
};

Pass follow(const std::vector<Camera>& cameras, double fps, std::span<const RecordedView> frames,
            const PoseStageOptions& options, bool backwards) {
    PoseStage stage(cameras, fps, options);
    const BodyModel model(options.body);
    Pass pass;
    pass.frames.resize(frames.size());
    pass.cost.assign(frames.size(), std::numeric_limits<double>::infinity());
    pass.joints.resize(frames.size());
    for (std::size_t k = 0; k < frames.size(); ++k) {
        const std::size_t n = backwards ? frames.size() - 1 - k : k;
        if (!frames[n].seen) {
            stage.reset();
            continue;
        }
        const std::int64_t time_ns = backwards ? -frames[n].seen->time_ns : frames[n].seen->time_ns;
        pass.frames[n].pose =
            stage.process(frames[n].subject_id, frames[n].sequence, time_ns, *frames[n].seen, {});
        if (!pass.frames[n].pose) continue;
        pass.frames[n].pose->capture_time_ns = frames[n].seen->time_ns;
        pass.frames[n].posture = stage.tracked()->fit.posture;
        pass.cost[n] = stage.data_cost();
        pass.joints[n] = model.forward(*pass.frames[n].posture).joints_in_world;
    }
    return pass;
}

double jump(const std::array<Vec3, kJointNames.size()>& a, const std::array<Vec3, kJointNames.size()>& b,
            double std_m) {
    double sum = 0;
    for (std::size_t j = 0; j < a.size(); ++j) sum += dot(a[j] - b[j], a[j] - b[j]);
    return sum / (std_m * std_m);
}

}  // namespace

// The cheapest path through the two passes (Viterbi): data cost of each frame set plus jumps between them.
std::vector<RetrackedFrame> retrack(const std::vector<Camera>& cameras, double fps,
                                    std::span<const RecordedView> frames, const PoseStageOptions& options) {
    PoseStageOptions unfiltered = options;
    unfiltered.filtered = false;
    unfiltered.tracker.always_search_limbs = true;
    std::array<Pass, 2> passes;
    oneapi::tbb::parallel_invoke([&] { passes[0] = follow(cameras, fps, frames, unfiltered, false); },
                                 [&] { passes[1] = follow(cameras, fps, frames, unfiltered, true); });
    const std::size_t count = frames.size();
    std::vector<std::array<int, 2>> came_from(count);
    std::array<double, 2> best{0, 0};
    const double jump_std_m = kJumpStd_m * std::max(1.0, reference_intervals(1 / fps));
    constexpr double kNothing =
        1e6;  // cost of a frame set without a pose, so that an existing pose is preferred
    for (std::size_t n = 0; n < count; ++n) {
        std::array<double, 2> next;
        for (int to = 0; to < 2; ++to) {
            const bool here = passes[to].frames[n].posture.has_value();
            next[to] = std::numeric_limits<double>::infinity();
            for (int from = 0; from < 2; ++from) {
                const bool linked = n > 0 && here && passes[from].frames[n - 1].posture;
                const double by = n == 0 ? 0 : best[from];
                const double jumped =
                    linked ? jump(passes[from].joints[n - 1], passes[to].joints[n], jump_std_m) : 0;
                const double total = by + jumped + (here ? passes[to].cost[n] : kNothing);
                if (total < next[to]) next[to] = total, came_from[n][to] = from;
            }
        }
        best = next;
    }
    std::vector<RetrackedFrame> result(count);
    int at = best[0] <= best[1] ? 0 : 1;
    for (std::size_t n = count; n-- > 0;) {
        result[n] = std::move(passes[at].frames[n]);
        at = came_from[n][at];
    }
    return result;
}

}  // namespace kinevox
