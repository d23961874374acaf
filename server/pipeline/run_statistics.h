// Rates and stage times of the latest results, for the status.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <mutex>

#include "server/pipeline/frame_result.h"

namespace kinevox {

struct RunSnapshot {
    std::uint64_t result_count = 0;  // since reset()
    std::uint64_t lost_count = 0;    // frame sets lost before the pipeline, from the gaps in the sequence
    std::uint64_t latest_sequence = 0;
    double result_rate_hz = 0;  // over the last two seconds
    StageTimes latest;
    StageTimes median;  // over the last kWindow results, per stage
    double total_p99_ms = 0;
};

// Any thread.
class RunStatistics {
  public:
    using Clock = std::chrono::steady_clock;
    static constexpr std::size_t kWindow = 128;

    void reset();
    void add(std::uint64_t sequence, const StageTimes& times, Clock::time_point now = Clock::now());
    RunSnapshot snapshot(Clock::time_point now = Clock::now()) const;

  private:
    mutable std::mutex mutex_;
    std::uint64_t results_ = 0, lost_ = 0, latest_sequence_ = 0;
    std::deque<StageTimes> times_;
    std::deque<Clock::time_point> arrivals_;  // of the last two seconds
};

}  // namespace kinevox
