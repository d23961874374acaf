// Subscribers of streams: what they share of a state, and of the rate that this machine can send.
#pragma once

#include <absl/status/status.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "server/calibration/procedure/procedure.h"
#include "server/events/mailbox.h"
#include "server/pose/database/database_service.h"
#include "server/pose/live_body_fit.h"

namespace kinevox {

// Subscribers of a state of which only the latest value matters: pose database, body fit, calibration
// procedure. Any thread. A subscription lasts as long as the caller keeps the mailbox, which holds the latest
// state only.
template <typename State>
class StateWatch {
  public:
    using Box = Mailbox<State>;

    // Starts with the latest published state.
    std::shared_ptr<Box> subscribe(std::function<void()> on_ready) {
        auto box = std::make_shared<Box>(MailboxOptions{}, std::move(on_ready));
        const std::scoped_lock lock(mutex_);
        box->put(latest_);
        if (!closed_.ok()) box->close(closed_);
        boxes_.push_back(box);
        return box;
    }

    void publish(const State& state) {
        const std::scoped_lock lock(mutex_);  // held while putting, so that an older state cannot arrive last
        latest_ = state;
        std::erase_if(boxes_, [](const auto& box) { return box.expired(); });
        for (const auto& weak : boxes_)
            if (const auto box = weak.lock()) box->put(state);
    }

    bool watched() const {
        const std::scoped_lock lock(mutex_);
        return std::ranges::any_of(boxes_, [](const auto& box) { return !box.expired(); });
    }

    // Closes all mailboxes, and those subscribed later. `why` is the status of their streams.
    void close(const absl::Status& why) {
        const std::scoped_lock lock(mutex_);
        closed_ = why;
        for (const auto& weak : boxes_)
            if (const auto box = weak.lock()) box->close(why);
    }

  private:
    mutable std::mutex mutex_;
    std::vector<std::weak_ptr<Box>> boxes_;
    State latest_;
    absl::Status closed_;
};

using DatabaseWatch = StateWatch<DatabaseProgress>;
using BodyWatch = StateWatch<std::vector<BodyFitProgress>>;
using ProcedureWatch = StateWatch<ProcedureProgress>;

// The message period of each latest-only subscriber, so that all of them together stay within the rate that
// this machine can send. Messages written faster than the clients read wait in the sockets, where newer ones
// cannot replace them, and take CPU time from the capture. Any thread.
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
