// For how long a thread has had the same frame set in hand: tells a pipeline that hangs from one that has
// nothing to do.
#pragma once

#include <atomic>
#include <chrono>

namespace kinevox {

// held() by any thread, the others by the one that works.
class InHand {
  public:
    using Clock = std::chrono::steady_clock;

    void take(Clock::time_point now = Clock::now()) { since_ = now.time_since_epoch().count(); }
    void put_down() { since_ = kNothing; }
    // Zero while there is nothing in hand.
    Clock::duration held(Clock::time_point now = Clock::now()) const {
        const Clock::rep since = since_;
        return since == kNothing ? Clock::duration{} : now.time_since_epoch() - Clock::duration(since);
    }

  private:
    static constexpr Clock::rep kNothing = -1;
    std::atomic<Clock::rep> since_{kNothing};
};

}  // namespace kinevox
