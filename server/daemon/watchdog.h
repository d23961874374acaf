// When the service manager is told that all is well, and when that something hangs.
#pragma once

#include <chrono>
#include <functional>

namespace kinevox {

// Used by one thread. An idle pipeline is well: only a frame set that does not come out of it is not.
class Watchdog {
  public:
    enum class Word { kNone, kAlive, kHung };

    // `interval`: within which the service manager wants to hear; zero: it does not watch.
    explicit Watchdog(std::chrono::nanoseconds interval) : interval_(interval) {}

    // To be asked each period(). `in_hand`: how long the pipeline has had a frame set in hand. kHung once for
    // each that is kept for max_in_hand(); after that nothing until it has come out.
    Word look(std::chrono::nanoseconds in_hand);

    std::chrono::nanoseconds max_in_hand() const { return interval_ / 2; }
    // Four looks an interval: one that comes late is not missed. A second at most, for the status.
    std::chrono::nanoseconds period() const;

  private:
    const std::chrono::nanoseconds interval_;
    bool hung_ = false;
};

}  // namespace kinevox
