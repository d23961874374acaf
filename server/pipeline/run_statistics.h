// What is measured of a run, for the status and the watchdog: rates and stage times of the latest results,
// and how long a frame set takes.
#pragma once

#include <atomic>
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

// How long a thread has been busy with the same frame set: distinguishes a pipeline that hangs from an idle
// one. elapsed() by any thread, the others by the one that works.
class BusyTimer {
  public:
    using Clock = std::chrono::steady_clock;

    void begin(Clock::time_point now = Clock::now()) { since_ = now.time_since_epoch().count(); }
    void end() { since_ = kIdle; }
    // Zero while idle.
    Clock::duration elapsed(Clock::time_point now = Clock::now()) const {
        const Clock::rep since = since_;
        return since == kIdle ? Clock::duration{} : now.time_since_epoch() - Clock::duration(since);
    }

  private:
    static constexpr Clock::rep kIdle = -1;
    std::atomic<Clock::rep> since_{kIdle};
};

}  // namespace kinevox
