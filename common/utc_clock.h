// UTC, used at the edges of the system; inside, times are the steady clock's.
#pragma once

#include <chrono>
#include <cstdint>

namespace kinevox {

inline std::int64_t utc_now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(
               std::chrono::system_clock::now().time_since_epoch())
        .count();
}

// Whether a frame set of this time is of the present: a live source's times are the steady clock's, a
// recording's start at 0.
bool is_live(std::int64_t capture_time_ns);

// The offset that converts a run's capture times to UTC, from the first of them. A recording's times are
// mapped to the time since the run's start.
std::int64_t utc_minus_capture_ns(std::int64_t first_capture_time_ns);

// Detects steps of the system clock. Used by one thread.
class ClockSteps {
  public:
    ClockSteps() : utc_minus_steady_ns_(utc_minus_steady_ns()) {}
    // The step since the construction or the last non-zero return value, if it is half a second or more; else
    // 0.
    std::int64_t step_ns();

  private:
    static std::int64_t utc_minus_steady_ns();
    std::int64_t utc_minus_steady_ns_;
};

}  // namespace kinevox
