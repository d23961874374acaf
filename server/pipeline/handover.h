// One value on its way from a thread to the next. Holds one at most: the giver waits for the taker.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <utility>

namespace kinevox {

// Thread safe. Closed until it is opened; what it held when it was closed is dropped.
template <class T>
class Handover {
  public:
    // Nobody may be in push() or pop().
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

    // False once it is closed.
    bool push(T value) {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return closed_ || !ready_; });
        if (closed_) return false;
        ready_ = std::move(value);
        changed_.notify_all();
        return true;
    }

    // Takes the place of what waits there. False once it is closed.
    bool replace(T value) {
        const std::scoped_lock lock(mutex_);
        if (closed_) return false;
        ready_ = std::move(value);
        changed_.notify_all();
        return true;
    }

    // Waits until nothing waits there. False once it is closed.
    bool wait_until_empty() {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return closed_ || !ready_; });
        return !closed_;
    }

    // Waits until there is one, or it is closed; false: neither within that time.
    bool wait_for_one(std::chrono::milliseconds longest) {
        std::unique_lock lock(mutex_);
        return changed_.wait_for(lock, longest, [&] { return closed_ || ready_; });
    }

    // Empty once it is closed.
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
