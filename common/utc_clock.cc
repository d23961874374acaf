#include "common/utc_clock.h"

#include <cstdlib>

namespace kinevox {
namespace {

std::int64_t steady_now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(
               std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

}  // namespace

bool is_live(std::int64_t capture_time_ns) {
    constexpr std::int64_t kNearNs = 60'000'000'000;
    return std::abs(steady_now_ns() - capture_time_ns) < kNearNs;
}

std::int64_t utc_minus_capture_ns(std::int64_t first_capture_time_ns) {
    return utc_now_ns() - (is_live(first_capture_time_ns) ? steady_now_ns() : first_capture_time_ns);
}

std::int64_t ClockSteps::utc_minus_steady_ns() {
    return utc_now_ns() - steady_now_ns();
}

std::int64_t ClockSteps::step_ns() {
    constexpr std::int64_t kStepNs = 500'000'000;
    const std::int64_t step_ns = utc_minus_steady_ns() - utc_minus_steady_ns_;
    if (std::abs(step_ns) < kStepNs) return 0;
    utc_minus_steady_ns_ += step_ns;
    return step_ns;
}

}  // namespace kinevox
