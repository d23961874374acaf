#include "server/tools/process/progress_bar.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>

namespace kinevox {

ProgressBar::ProgressBar(std::int64_t total, bool quiet) : total_(total), line_(quiet) {}

void ProgressBar::show(std::int64_t done) {
    if (!line_.due()) return;
    const double seconds = std::chrono::duration<double>(Clock::now() - start_).count();
    const double rate = static_cast<double>(done) / std::max(seconds, 1e-6);
    if (total_ <= 0) {
        line_.draw(fmt::format("{} frame sets, {:.0f} per second", done, rate));
    } else {
        constexpr int kWidth = 40;
        const int filled = static_cast<int>(std::min<std::int64_t>(kWidth, kWidth * done / total_));
        const double left_s = static_cast<double>(total_ - done) / std::max(rate, 1e-6);
        line_.draw(fmt::format("[{}{}] {}/{}  {:.0f} per second, {:.0f} s left", std::string(filled, '='),
                               std::string(kWidth - filled, ' '), done, total_, rate, left_s));
    }
}

}  // namespace kinevox
