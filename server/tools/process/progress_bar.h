// One line that tells how far a long run is.
#pragma once

#include <chrono>
#include <cstdint>

namespace kinevox {

// Draws on standard error, at most ten times a second, and only if that is a terminal.
class ProgressBar {
  public:
    // total < 0: unknown.
    explicit ProgressBar(std::int64_t total, bool quiet);
    ~ProgressBar();
    void show(std::int64_t done);

  private:
    using Clock = std::chrono::steady_clock;
    std::int64_t total_;
    bool on_;
    Clock::time_point start_ = Clock::now(), drawn_{};
};

}  // namespace kinevox
