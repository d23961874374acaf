#include "server/pipeline/utc_clock.h"

#include <cstdlib>

namespace kinevox {

std::int64_t utc_minus_capture_ns(std::int64_t first_capture_time_ns) {
    constexpr std::int64_t kNearNs = 60'000'000'000;
    const std::int64_t steady_now_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(
                                           std::chrono::steady_clock::now().time_since_epoch()).count();
    const bool live = std::abs(steady_now_ns - first_capture_time_ns) < kNearNs;
    return utc_now_ns() - (live ? steady_now_ns : first_capture_time_ns);
}

}  // namespace kinevox
