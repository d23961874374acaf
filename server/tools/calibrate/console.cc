#include "server/tools/calibrate/console.h"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <memory>

namespace kinevox::calibrate {

SolveProgress console_progress(bool quiet) {
    if (quiet || !isatty(STDERR_FILENO)) return {};
    using Clock = std::chrono::steady_clock;
    const auto drawn = std::make_shared<Clock::time_point>();
    return [drawn](double part, const std::string& what) {
        const auto now = Clock::now();
        if (part < 1 && now - *drawn < std::chrono::milliseconds(100)) return true;
        *drawn = now;
        fmt::print(stderr, "\r\033[K{:3.0f} %  {}", 100 * part, what);
        if (part >= 1) fmt::print(stderr, "\r\033[K");
        std::fflush(stderr);
        return true;
    };
}

}  // namespace kinevox::calibrate
