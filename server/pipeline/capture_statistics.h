// What is counted for the metrics while the capture runs; everything else is queried when they are read.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "server/pipeline/frame_result.h"

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

// Counted into while the capture runs, by any thread. Never waits: a reader may see a count whose sum is not
// added yet.
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

// Of the subscribers of one kind of stream.
struct StreamStatistics {
    RunningHistogram latency;  // from publication to handing the message to gRPC
    std::atomic<std::uint64_t> sent{0}, missed{0};

    void record(double latency_s, std::uint64_t missed_before) {
        latency.add(latency_s);
        sent.fetch_add(1, std::memory_order_relaxed);
        missed.fetch_add(missed_before, std::memory_order_relaxed);
    }
};

// Any thread; since the daemon's start.
struct CaptureStatistics {
    RunningHistogram segmentation, tracking, hull, colouring, pose, total;
    StreamStatistics volumes, poses, images;

    void observe(const StageTimes& times) {
        segmentation.add(times.segmentation_ms / 1e3);
        tracking.add(times.tracking_ms / 1e3);
        hull.add(times.hull_ms / 1e3);
        colouring.add(times.colouring_ms / 1e3);
        pose.add(times.pose_ms / 1e3);
        total.add(times.total_ms / 1e3);
    }
};

}  // namespace kinevox
