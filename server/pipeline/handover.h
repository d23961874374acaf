// Hands values from one thread to the next. Holds at most one: the producer waits for the consumer.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <utility>

namespace kinevox {

// Thread safe. Closed until it is opened; close() drops the value.
template <class T>
class Handover {
  public:
    // No thread may be in push() or pop().
    void open() {
        const std::scoped_lock lock(mutex_);
        ready_.reset();
        closed_ = false;
    }

    void close() {
        const std::scoped_lock lock(mutex_);
        ready_.reset();
        closed_ = true;
        changed_.notify_all();
    }

    // False once closed.
    bool push(T value) {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return closed_ || !ready_; });
        if (closed_) return false;
        ready_ = std::move(value);
        changed_.notify_all();
        return true;
    }

    // Replaces a waiting value. False once closed.
    bool replace(T value) {
        const std::scoped_lock lock(mutex_);
        if (closed_) return false;
        ready_ = std::move(value);
        changed_.notify_all();
        return true;
    }

    // False once closed.
    bool wait_until_empty() {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return closed_ || !ready_; });
        return !closed_;
    }

    // Waits for a value or close(); false: neither within that time.
    bool wait_for_one(std::chrono::milliseconds timeout) {
        std::unique_lock lock(mutex_);
        return changed_.wait_for(lock, timeout, [&] { return closed_ || ready_; });
    }

    // Empty once closed.
    std::optional<T> pop() {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return closed_ || ready_; });
        std::optional<T> taken = std::move(ready_);
        ready_.reset();
        changed_.notify_all();
        return taken;
    }

  private:
    std::mutex mutex_;
    std::condition_variable changed_;
    std::optional<T> ready_;
    bool closed_ = true;
};

}  // namespace kinevox
