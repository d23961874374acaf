// A histogram that is counted into while the capture runs.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

namespace kinevox {

struct Histogram {
    std::vector<double> bounds;         // upper bounds, increasing; one above all is implied
    std::vector<std::uint64_t> counts;  // per bound and above the last: bounds.size() + 1
    double sum = 0;
};

// From half a millisecond, by steps of a factor of two to three, to five seconds: the range of all stages and
// latencies.
inline constexpr std::array kTimeBounds_s = {0.0005, 0.001, 0.002, 0.005, 0.01, 0.015, 0.02, 0.03, 0.05,
                                             0.075,  0.1,   0.15,  0.2,   0.3,  0.5,   1.0,  2.0,  5.0};

// Any thread. Never waits: a reader may see a count whose sum is not added yet.
class RunningHistogram {
  public:
    void add(double seconds) {
        std::size_t bin = 0;
        while (bin < kTimeBounds_s.size() && seconds > kTimeBounds_s[bin]) ++bin;
        counts_[bin].fetch_add(1, std::memory_order_relaxed);
        sum_ns_.fetch_add(static_cast<std::int64_t>(seconds * 1e9), std::memory_order_relaxed);
    }

    Histogram read() const {
        Histogram out{{kTimeBounds_s.begin(), kTimeBounds_s.end()}, {}, 0};
        for (const auto& count : counts_) out.counts.push_back(count.load(std::memory_order_relaxed));
        out.sum = 1e-9 * static_cast<double>(sum_ns_.load(std::memory_order_relaxed));
        return out;
    }

  private:
    std::array<std::atomic<std::uint64_t>, kTimeBounds_s.size() + 1> counts_{};
    std::atomic<std::int64_t> sum_ns_{0};
};

}  // namespace kinevox
