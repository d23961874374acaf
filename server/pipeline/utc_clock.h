// UTC, which the pipeline's edges tell times in; inside, it counts the steady clock.
#pragma once

#include <chrono>
#include <cstdint>

namespace kinevox {

inline std::int64_t utc_now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(
               std::chrono::system_clock::now().time_since_epoch())
        .count();
}

// Whether a frame set of this time shows what happens now: a live source's times are the steady clock's, a
// recording's count from 0.
bool is_live(std::int64_t capture_time_ns);

// What makes UTC of a run's capture times, from the first of them. A live source's are the steady clock's,
// thus near now; a recording's count from 0 and become the time since the run's start.
std::int64_t utc_minus_capture_ns(std::int64_t first_capture_time_ns);

// Whether somebody or a time server sets the machine's clock. Used by one thread.
class ClockSteps {
  public:
    ClockSteps() : utc_minus_steady_ns_(utc_minus_steady_ns()) {}
    // By how much it was set since this was made or last returned something else than 0, where that is half a
    // second or more; else 0.
    std::int64_t step_ns();

  private:
    static std::int64_t utc_minus_steady_ns();
    std::int64_t utc_minus_steady_ns_;
};

}  // namespace kinevox
