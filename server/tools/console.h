// Ctrl-C as a call, and a progress line on a terminal.
#pragma once

#include <functional>
#include <thread>

#include "server/calibration/finding.h"

namespace kinevox {

// Calls `on_interrupt` once, on a thread of its own, when SIGINT or SIGTERM arrives while it lives. Make it
// before other threads start: it blocks the two signals for them.
class Interrupt {
  public:
    explicit Interrupt(std::function<void()> on_interrupt);

  private:
    std::jthread thread_;
};

// Draws on standard error if that is a terminal, at most ten times per second. Ctrl-C cancels at the next
// call. Create it before other threads start.
SolveProgress console_progress(bool quiet);

}  // namespace kinevox
