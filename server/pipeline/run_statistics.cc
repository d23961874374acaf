#include "server/pipeline/run_statistics.h"

#include <algorithm>
#include <vector>

#include "common/median.h"

namespace kinevox {
namespace {

constexpr std::chrono::seconds kRateWindow{2};

double quantile(std::vector<double> values, double q) {
    return values.empty() ? 0 : quantile_of(values, q);
}

}  // namespace

void RunStatistics::reset() {
    const std::scoped_lock lock(mutex_);
    results_ = lost_ = latest_sequence_ = 0;
    times_.clear();
    arrivals_.clear();
}

void RunStatistics::add(std::uint64_t sequence, const StageTimes& times, Clock::time_point now) {
    const std::scoped_lock lock(mutex_);
    if (results_ > 0 && sequence > latest_sequence_ + 1) lost_ += sequence - latest_sequence_ - 1;
    latest_sequence_ = sequence;
    ++results_;
    times_.push_back(times);
    if (times_.size() > kWindow) times_.pop_front();
    arrivals_.push_back(now);
    while (arrivals_.front() < now - kRateWindow) arrivals_.pop_front();
}

RunSnapshot RunStatistics::snapshot(Clock::time_point now) const {
    std::vector<StageTimes> times;
    RunSnapshot out;
    {
        const std::scoped_lock lock(mutex_);
        out.result_count = results_;
        out.lost_count = lost_;
        out.latest_sequence = latest_sequence_;
        times.assign(times_.begin(), times_.end());
        const auto first = std::ranges::find_if(arrivals_, [&](auto t) { return t >= now - kRateWindow; });
        const auto count = arrivals_.end() - first;
        // Right after a start the window is not full yet: then the time since its first result counts.
        if (count > 1) {
            const std::chrono::duration<double> span = arrivals_.back() - *first;
            const std::chrono::duration<double> idle = now - arrivals_.back();
            const double period_s = span.count() / static_cast<double>(count - 1);
            const double busy_s = span.count() + std::max(0.0, idle.count() - period_s);
            if (busy_s > 0) out.result_rate_hz = static_cast<double>(count - 1) / busy_s;
        }
    }
    if (times.empty()) return out;
    out.latest = times.back();
    std::vector<double> values;
    const auto column = [&](double StageTimes::*field) -> const std::vector<double>& {
        values.clear();
        for (const StageTimes& t : times) values.push_back(t.*field);
        return values;
    };
    for (double StageTimes::*field :
         {&StageTimes::decode_ms, &StageTimes::segmentation_ms, &StageTimes::tracking_ms,
          &StageTimes::hull_ms, &StageTimes::colouring_ms, &StageTimes::pose_ms, &StageTimes::total_ms})
        out.median.*field = quantile(column(field), 0.5);
    out.total_p99_ms = quantile(column(&StageTimes::total_ms), 0.99);
    return out;
}

}  // namespace kinevox
