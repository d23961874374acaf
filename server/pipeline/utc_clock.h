// UTC, which the pipeline's edges tell times in; inside, it counts the steady clock.
#pragma once

#include <chrono>
#include <cstdint>

namespace kinevox {

inline std::int64_t utc_now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(
               std::chrono::system_clock::now().time_since_epoch()).count();
}

// What makes UTC of a run's capture times, from the first of them. A live source's are the steady clock's, thus near
// now; a recording's count from 0 and become the time since the run's start.
std::int64_t utc_minus_capture_ns(std::int64_t first_capture_time_ns);

}  // namespace kinevox
