#include "server/tools/calibrate/console.h"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <memory>

#include "server/tools/interrupt.h"

namespace kinevox::calibrate {

namespace {

struct Console {
    std::atomic<bool> interrupted = false;
    std::chrono::steady_clock::time_point drawn;
    Interrupt interrupt{[this] { interrupted = true; }};   // last: its thread ends first
};

}  // namespace

SolveProgress console_progress(bool quiet) {
    const bool draws = !quiet && isatty(STDERR_FILENO);
    return [draws, console = std::make_shared<Console>()](double part, const std::string& what) {
        if (console->interrupted) {
            if (draws) fmt::print(stderr, "\r\033[K");
            return false;
        }
        const auto now = std::chrono::steady_clock::now();
        if (!draws || (part < 1 && now - console->drawn < std::chrono::milliseconds(100))) return true;
        console->drawn = now;
        fmt::print(stderr, "\r\033[K{:3.0f} %  {}", 100 * part, what);
        if (part >= 1) fmt::print(stderr, "\r\033[K");
        std::fflush(stderr);
        return true;
    };
}

}  // namespace kinevox::calibrate
