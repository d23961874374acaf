#include "server/pose/floating_body.h"

#include <algorithm>

#include "server/pose/each_run.h"
#include "server/pose/pose_cost.h"

namespace kinevox {
namespace {

// Of the lower foot's sole. Heels and soles unlike the model's seem to float, too, by less.
constexpr double kMinHeight_m = 0.04, kMinHeightAgain_m = 0.03, kMaxHeight_m = 0.25;
constexpr double kMaxFlight_s = 0.6;
constexpr double kMinClearance_m = 0.25;                 // of the rest of a body that stands
constexpr double kLowFraction = 0.25, kSpread_m = 0.03;  // of the frame sets: those that stand

}  // namespace

std::vector<std::size_t> floating_frames(const BodyModel& model, std::span<const BodyPosture> postures,
                                         std::span<const std::int64_t> times_ns, bool stood) {
    const double min_height_m = stood ? kMinHeightAgain_m : kMinHeight_m;
    std::vector<BodyCapsule> capsules;
    std::vector<double> heights;
    for (const BodyPosture& posture : postures) {
        model.capsules(model.forward(posture), capsules);
        const StandingFoot foot = lower_foot(capsules);
        heights.push_back(foot.others_m > kMinClearance_m ? foot.height_m : 0);
    }
    std::vector<std::size_t> frames;
    each_run(
        heights.size(), [&](std::size_t n) { return heights[n] > min_height_m; },
        [&](std::size_t first, std::size_t end) {
            if (1e-9 * static_cast<double>(times_ns[end - 1] - times_ns[first]) <= kMaxFlight_s) return;
            std::vector<double> sorted(heights.begin() + first, heights.begin() + end);
            std::sort(sorted.begin(), sorted.end());
            const double low =
                sorted[static_cast<std::size_t>(kLowFraction * static_cast<double>(sorted.size()))];
            if (low > kMaxHeight_m) return;
            for (std::size_t n = first; n < end; ++n)
                if (heights[n] < low + kSpread_m) frames.push_back(n);
        });
    return frames;
}

}  // namespace kinevox
