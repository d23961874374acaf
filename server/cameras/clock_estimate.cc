#include "server/cameras/clock_estimate.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace kinevox {
namespace {

constexpr double kWindow_s = 1;
constexpr std::size_t kMaxWindows = 60;
constexpr double kMinSpan_s = 10;      // over less time the drift is hidden by the delays
constexpr double kMaxDrift = 500e-6;   // quartz oscillators are better
constexpr double kJump_s = 1;          // longer than any network delay: the clock was set
constexpr double kJumpAhead_s = 0.02;  // an image cannot arrive before its capture

}  // namespace

std::int64_t ClockEstimate::add(std::int64_t timestamp_ns, std::int64_t arrival_ns) {
    for (;;) {
        if (samples_ == 0) {
            timestamp_0_ns_ = timestamp_ns;
            arrival_0_ns_ = arrival_ns;
        }
        const double timestamp_s = static_cast<double>(timestamp_ns - timestamp_0_ns_) * 1e-9;
        const double arrival_s = static_cast<double>(arrival_ns - arrival_0_ns_) * 1e-9;
        const Point point{timestamp_s, arrival_s - timestamp_s};
        if (samples_ > 0) {
            const double delay_s = point.offset_s - offset_at(timestamp_s);
            const bool warming_up = samples_ < kSettled;
            if (std::abs(delay_s) > kJump_s ||
                (!warming_up && delay_s < -kJumpAhead_s - kMaxDrift * kWindow_s)) {
                reset();
                continue;
            }
        }
        if (samples_ == 0 || point.offset_s < lowest_.offset_s) lowest_ = point;
        ++samples_;
        last_timestamp_ns_ = timestamp_ns;
        if (timestamp_s - window_begin_s_ >= kWindow_s) {
            close_window();
            window_begin_s_ = timestamp_s;
            lowest_ = point;
        }
        const double taken_s = timestamp_s + std::min(offset_at(timestamp_s), point.offset_s);
        return arrival_0_ns_ + std::llround(taken_s * 1e9);
    }
}

// The edge of the points' lower hull at their mean time: of all lines below the points the closest on
// average.
void ClockEstimate::close_window() {
    windows_.push_back(lowest_);
    if (windows_.size() > kMaxWindows) windows_.pop_front();
    if (windows_.back().timestamp_s - windows_.front().timestamp_s < kMinSpan_s) return;
    std::vector<Point> hull;
    double mean_s = 0;
    for (const Point& p : windows_) {
        mean_s += p.timestamp_s / static_cast<double>(windows_.size());
        while (hull.size() >= 2) {
            const Point &a = hull[hull.size() - 2], &b = hull.back();
            const double cross = (b.timestamp_s - a.timestamp_s) * (p.offset_s - a.offset_s) -
                                 (b.offset_s - a.offset_s) * (p.timestamp_s - a.timestamp_s);
            if (cross > 0) break;
            hull.pop_back();
        }
        hull.push_back(p);
    }
    std::size_t right = 1;
    while (right + 1 < hull.size() && hull[right].timestamp_s < mean_s) ++right;
    const Point &a = hull[right - 1], &b = hull[right];
    slope_ = std::clamp((b.offset_s - a.offset_s) / (b.timestamp_s - a.timestamp_s), -kMaxDrift, kMaxDrift);
    anchor_ = a;
    fitted_ = true;
    drift_ = -slope_;  // the offset of a fast clock decreases
}

double ClockEstimate::offset_at(double timestamp_s) const {
    if (fitted_) return anchor_.offset_s + slope_ * (timestamp_s - anchor_.timestamp_s);
    // The latest three windows: drift is negligible over this time.
    double lowest = lowest_.offset_s;
    for (std::size_t n = 0; n < std::min<std::size_t>(2, windows_.size()); ++n)
        lowest = std::min(lowest, windows_[windows_.size() - 1 - n].offset_s);
    return lowest;
}

}  // namespace kinevox
