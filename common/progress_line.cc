#include "common/progress_line.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

namespace kinevox {

ProgressLine::ProgressLine(bool quiet) : on_(!quiet && isatty(STDERR_FILENO) != 0) {}

bool ProgressLine::due() {
    if (!on_) return false;
    const auto now = std::chrono::steady_clock::now();
    if (now - drawn_ < std::chrono::milliseconds(100)) return false;
    drawn_ = now;
    return true;
}

void ProgressLine::draw(std::string_view text) {
    if (!on_) return;
    fmt::print(stderr, "\r\033[K{}", text);
    std::fflush(stderr);
    shown_ = true;
}

void ProgressLine::show(double progress) {
    if (due()) draw(fmt::format("{:3.0f} %", 100 * progress));
}

void ProgressLine::clear() {
    if (shown_) std::fputs("\r\033[K", stderr);
    shown_ = false;
}

}  // namespace kinevox
