// Time that has passed on the steady clock.
#pragma once

#include <chrono>

namespace kinevox {

class Stopwatch {
  public:
    double seconds() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }
    double ms() const { return 1e3 * seconds(); }

  private:
    using Clock = std::chrono::steady_clock;
    Clock::time_point start_ = Clock::now();
};

}  // namespace kinevox
