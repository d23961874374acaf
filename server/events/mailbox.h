// A bounded queue between a publisher and one subscriber. put() never blocks: when the queue is full, either
// the oldest message is dropped, or the mailbox overflows and reports it.
#pragma once

#include <absl/status/status.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <utility>

namespace kinevox {

struct MailboxOptions {
    enum class WhenFull { kDropOldest, kOverflow };
    WhenFull when_full = WhenFull::kDropOldest;
    std::size_t max_messages = 1;      // 1 with kDropOldest: the latest only
    std::size_t max_bytes = SIZE_MAX;  // sum of size_bytes of put(); a single message always fits
};

// put() by one producer, take() and status() by one consumer, close() by any thread. `on_ready` is called,
// without a lock held, on the producer's or closer's thread after each change for the consumer; it must only
// notify.
template <typename T>
class Mailbox {
  public:
    struct Taken {
        T message;
        std::uint64_t missed = 0;  // messages dropped between the previous one and this one
    };

    Mailbox(const MailboxOptions& options, std::function<void()> on_ready)
        : options_(options), on_ready_(std::move(on_ready)) {}

    void put(T message, std::size_t size_bytes = 0) {
        std::deque<Entry> dropped;  // destroyed after the lock is gone
        {
            const std::scoped_lock lock(mutex_);
            if (!status_.ok()) return;
            const auto full = [&] {
                return !queue_.empty() &&
                       (queue_.size() >= options_.max_messages || bytes_ + size_bytes > options_.max_bytes);
            };
            if (full() && options_.when_full == MailboxOptions::WhenFull::kOverflow) {
                status_ = absl::ResourceExhaustedError("the queue is full");
                dropped.swap(queue_);
                bytes_ = 0;
            } else {
                while (full()) {
                    bytes_ -= queue_.front().size_bytes;
                    dropped.push_back(std::move(queue_.front()));
                    queue_.pop_front();
                    ++missed_;
                }
                queue_.push_back({std::move(message), size_bytes});
                bytes_ += size_bytes;
            }
        }
        on_ready_();
    }

    // The oldest queued message, if there is one. Messages queued before close() are still returned; an
    // overflow empties the queue.
    std::optional<Taken> take() {
        const std::scoped_lock lock(mutex_);
        if (queue_.empty()) return std::nullopt;
        Taken taken{std::move(queue_.front().message), std::exchange(missed_, 0)};
        bytes_ -= queue_.front().size_bytes;
        queue_.pop_front();
        return taken;
    }

    // OK while open; ResourceExhausted after an overflow; else the status passed to close().
    absl::Status status() const {
        const std::scoped_lock lock(mutex_);
        return status_;
    }

    // The first status stays. `why` is not OK.
    void close(absl::Status why) {
        {
            const std::scoped_lock lock(mutex_);
            if (!status_.ok()) return;
            status_ = std::move(why);
        }
        on_ready_();
    }

    std::size_t queued() const {
        const std::scoped_lock lock(mutex_);
        return queue_.size();
    }

  private:
    struct Entry {
        T message;
        std::size_t size_bytes = 0;
    };

    const MailboxOptions options_;
    const std::function<void()> on_ready_;
    mutable std::mutex mutex_;
    std::deque<Entry> queue_;
    std::size_t bytes_ = 0;
    std::uint64_t missed_ = 0;
    absl::Status status_;
};

}  // namespace kinevox
