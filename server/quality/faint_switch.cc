#include "server/quality/faint_switch.h"

#include <algorithm>
#include <string_view>
#include <vector>

#include "common/median.h"

namespace kinevox::quality {
namespace {

// Live, poses fit less well than those of `kinevox process`: seven shared sequences are at 9 to 17 mm, three
// trials with trousers like the floor at 24 to 37, and at 12 to 25 with judge_faint.
constexpr double kMaxLiveResidual_m = 0.019;
constexpr double kWindow_s = 1.5;                      // of the medians
constexpr std::size_t kMinPoses = 8;                   // of a median
constexpr double kMaxTrial_s = 10;                     // without enough poses of a known body
constexpr double kMaxFraction = 0.85;                  // of the residual, for a trial to be kept
constexpr double kFirstWait_s = 60, kMaxWait_s = 960;  // after a trial without success

std::int64_t nanoseconds(double seconds) {
    return static_cast<std::int64_t>(1e9 * seconds);
}

}  // namespace

bool may_lack_parts(std::span<const Cause> causes) {
    // The last three are also what missing legs or trunks look like.
    static constexpr std::string_view kMissingParts[] = {"silhouettes",  "withheld",    "background_occupied",
                                                         "still_object", "camera_time", "floor_height",
                                                         "scale"};
    return causes.empty() ||
           std::ranges::find(kMissingParts, causes.front().cause) != std::end(kMissingParts);
}

// Empty while the window is not full.
std::optional<double> FaintSwitch::median_m() const {
    if (latest_.size() < kMinPoses ||
        latest_.back().time_ns - latest_.front().time_ns < nanoseconds(0.9 * kWindow_s))
        return std::nullopt;
    std::vector<double> residuals;
    for (const Residual& each : latest_) residuals.push_back(each.residual_m);
    return median_of(residuals);
}

FaintSwitch::Change FaintSwitch::revert(std::int64_t time_ns) {
    state_ = State::kPlain;
    latest_.clear();
    wait_s_ = std::clamp(2 * wait_s_, kFirstWait_s, kMaxWait_s);
    next_trial_ns_ = time_ns + nanoseconds(wait_s_);
    return Change::kRevert;
}

FaintSwitch::Change FaintSwitch::update(std::int64_t time_ns, std::span<const double> residuals_m,
                                        bool explained) {
    if (time_ns < last_ns_) {  // another run
        latest_.clear();
        next_trial_ns_ = trial_since_ns_ = time_ns;
    }
    last_ns_ = time_ns;
    if (state_ == State::kKept) return Change::kNone;
    for (const double residual_m : residuals_m) latest_.push_back({time_ns, residual_m});
    while (!latest_.empty() && latest_.front().time_ns < time_ns - nanoseconds(kWindow_s))
        latest_.pop_front();
    const std::optional<double> residual_m = median_m();
    if (state_ == State::kPlain) {
        if (!residual_m || *residual_m <= kMaxLiveResidual_m || explained || time_ns < next_trial_ns_)
            return Change::kNone;
        state_ = State::kTrial;
        trial_since_ns_ = time_ns;
        before_m_ = after_m_ = *residual_m;
        latest_.clear();
        return Change::kTry;
    }
    if (residual_m) {
        after_m_ = *residual_m;
        if (after_m_ > kMaxFraction * before_m_) return revert(time_ns);
        state_ = State::kKept;
        latest_.clear();
        return Change::kKeep;
    }
    if (time_ns - trial_since_ns_ > nanoseconds(kMaxTrial_s)) return revert(time_ns);
    return Change::kNone;
}

}  // namespace kinevox::quality
