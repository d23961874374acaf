// How long a thread has been busy with the same frame set: distinguishes a pipeline that hangs from an idle
// one.
#pragma once

#include <atomic>
#include <chrono>

namespace kinevox {

// elapsed() by any thread, the others by the one that works.
class BusyTimer {
  public:
    using Clock = std::chrono::steady_clock;

    void begin(Clock::time_point now = Clock::now()) { since_ = now.time_since_epoch().count(); }
    void end() { since_ = kIdle; }
    // Zero while idle.
    Clock::duration elapsed(Clock::time_point now = Clock::now()) const {
        const Clock::rep since = since_;
        return since == kIdle ? Clock::duration{} : now.time_since_epoch() - Clock::duration(since);
    }

  private:
    static constexpr Clock::rep kIdle = -1;
    std::atomic<Clock::rep> since_{kIdle};
};

}  // namespace kinevox
