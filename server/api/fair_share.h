// The message period of each latest-only subscriber, so that all of them together stay within the rate that
// this machine can send. Messages written faster than the clients read wait in the sockets, where newer ones
// cannot replace them, and take CPU time from the capture.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

namespace kinevox {

// Any thread.
class FairShare {
  public:
    explicit FairShare(double messages_per_s) : messages_per_s_(messages_per_s) {}

    // One subscriber. The period of the others shrinks when it is destroyed.
    class Slot {
      public:
        explicit Slot(FairShare& share) : share_(share) { ++share_.slot_count_; }
        ~Slot() { --share_.slot_count_; }
        Slot(const Slot&) = delete;
        Slot& operator=(const Slot&) = delete;

        // Minimum time between two messages of one subscriber.
        std::chrono::nanoseconds period() const {
            return std::chrono::nanoseconds(
                static_cast<std::int64_t>(1e9 * share_.slot_count_ / share_.messages_per_s_));
        }

      private:
        FairShare& share_;
    };

  private:
    const double messages_per_s_;
    std::atomic<int> slot_count_ = 0;
};

}  // namespace kinevox
