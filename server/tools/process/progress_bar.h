// Progress of a run over frame sets.
#pragma once

#include <chrono>
#include <cstdint>

#include "common/progress_line.h"

namespace kinevox {

// A ProgressLine with the rate and the remaining time.
class ProgressBar {
  public:
    // total < 0: unknown.
    explicit ProgressBar(std::int64_t total, bool quiet);
    void show(std::int64_t done);

  private:
    using Clock = std::chrono::steady_clock;
    std::int64_t total_;
    ProgressLine line_;
    Clock::time_point start_ = Clock::now();
};

}  // namespace kinevox
