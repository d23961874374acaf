// UTC, which the pipeline's edges tell times in; inside, it counts the steady clock.
#pragma once

#include <chrono>
#include <cstdint>

namespace kinevox {

inline std::int64_t utc_now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(
               std::chrono::system_clock::now().time_since_epoch()).count();
}

}  // namespace kinevox
