// Rates and stage times of the newest results, for the status.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <mutex>

#include "server/pipeline/frame_result.h"

namespace kinevox {

struct RunFigures {
    std::uint64_t results = 0;  // since reset()
    std::uint64_t lost = 0;     // frame sets lost before the pipeline, from the gaps in the sequence
    std::uint64_t newest_sequence = 0;
    double results_per_second = 0;  // over the last two seconds
    StageTimes newest;
    StageTimes median;  // over the last kWindow results, each stage for itself
    double total_p99_ms = 0;
};

// Any thread.
class RunStatistics {
  public:
    using Clock = std::chrono::steady_clock;
    static constexpr std::size_t kWindow = 128;

    void reset();
    void add(std::uint64_t sequence, const StageTimes& times, Clock::time_point now = Clock::now());
    RunFigures figures(Clock::time_point now = Clock::now()) const;

  private:
    mutable std::mutex mutex_;
    std::uint64_t results_ = 0, lost_ = 0, newest_sequence_ = 0;
    std::deque<StageTimes> times_;
    std::deque<Clock::time_point> arrivals_;  // of the last two seconds
};

}  // namespace kinevox
