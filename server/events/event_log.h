// Publishes events to their subscribers and keeps the latest ones for later subscribers.
#pragma once

#include <absl/status/status.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "server/events/event.h"
#include "server/events/mailbox.h"

namespace kinevox {

struct PublishedEvent {
    std::uint64_t id = 0;  // counts from 1
    std::int64_t time_utc_ns = 0;
    std::uint32_t subject_id = 0;  // 0: no subject is concerned
    Event event;
};

using EventMailbox = Mailbox<PublishedEvent>;

// Any thread. A subscription lasts as long as the caller keeps the mailbox. No method may be called from
// on_ready.
class EventLog {
  public:
    // Starts with the latest `history_count` events.
    std::shared_ptr<EventMailbox> subscribe(std::size_t history_count, std::function<void()> on_ready);

    // `subject_id`: unless the event names one.
    void publish(Event event, std::int64_t time_utc_ns, std::uint32_t subject_id = 0);
    // At the present time.
    void publish(Event event);
    void publish(EventKind kind, std::string message, std::uint64_t sequence = 0);

    // Closes every mailbox, and those subscribed later. `why` is the status the streams end with.
    void close(const absl::Status& why);

    int subscriber_count() const;

    static constexpr std::size_t kMaxHistory = 100;
    static constexpr std::size_t kMaxQueued = 256;

  private:
    std::vector<std::shared_ptr<EventMailbox>> alive();  // with the mutex held

    mutable std::mutex mutex_;
    std::vector<std::weak_ptr<EventMailbox>> mailboxes_;
    std::deque<PublishedEvent> history_;
    std::uint64_t count_ = 0;
    absl::Status closed_;
};

}  // namespace kinevox
