// How often each of very many subscribers gets the newest message, so that all of them together take no more
// than this machine can send: what is written faster than the clients read waits in the sockets, where
// nothing newer can replace it, and the capture has no processor left.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

namespace kinevox {

// Any thread.
class FairShare {
  public:
    explicit FairShare(double messages_per_s) : messages_per_s_(messages_per_s) {}

    // A subscriber's place; the share of the others grows when it goes.
    class Place {
      public:
        explicit Place(FairShare& share) : share_(share) { ++share_.places_; }
        ~Place() { --share_.places_; }
        Place(const Place&) = delete;
        Place& operator=(const Place&) = delete;

        // Between two messages of one subscriber, at least.
        std::chrono::nanoseconds period() const {
            return std::chrono::nanoseconds(
                static_cast<std::int64_t>(1e9 * share_.places_ / share_.messages_per_s_));
        }

      private:
        FairShare& share_;
    };

  private:
    const double messages_per_s_;
    std::atomic<int> places_ = 0;
};

}  // namespace kinevox
