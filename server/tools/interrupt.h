// Ctrl-C as a call.
#pragma once

#include <functional>
#include <thread>

namespace kinevox {

// Calls `on_interrupt` once, on a thread of its own, when SIGINT or SIGTERM arrives while it lives. Make it
// before other threads start: it blocks the two signals for them.
class Interrupt {
  public:
    explicit Interrupt(std::function<void()> on_interrupt);

  private:
    std::jthread thread_;
};

}  // namespace kinevox
