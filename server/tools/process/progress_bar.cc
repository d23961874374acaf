#include "server/tools/process/progress_bar.h"

#include <algorithm>
#include <cstdio>
#include <string>

#include <fmt/format.h>
#include <unistd.h>

namespace kinevox {

ProgressBar::ProgressBar(std::int64_t total, bool quiet) : total_(total), on_(!quiet && isatty(STDERR_FILENO) != 0) {}

ProgressBar::~ProgressBar() {
    if (on_) std::fputs("\r\033[K", stderr);
}

void ProgressBar::show(std::int64_t done) {
    if (!on_) return;
    const Clock::time_point now = Clock::now();
    if (now - drawn_ < std::chrono::milliseconds(100)) return;
    drawn_ = now;
    const double seconds = std::chrono::duration<double>(now - start_).count();
    const double rate = static_cast<double>(done) / std::max(seconds, 1e-6);
    if (total_ <= 0) {
        fmt::print(stderr, "\r\033[K{} frame sets, {:.0f} a second", done, rate);
    } else {
        constexpr int kWidth = 40;
        const int filled = static_cast<int>(std::min<std::int64_t>(kWidth, kWidth * done / total_));
        const double left_s = static_cast<double>(total_ - done) / std::max(rate, 1e-6);
        fmt::print(stderr, "\r\033[K[{}{}] {}/{}  {:.0f} a second, {:.0f} s left", std::string(filled, '='),
                   std::string(kWidth - filled, ' '), done, total_, rate, left_s);
    }
    std::fflush(stderr);
}

}  // namespace kinevox
