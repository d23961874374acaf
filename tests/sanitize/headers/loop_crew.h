// Helper threads of loops under ThreadSanitizer. They are reused, since creating a thread takes milliseconds
// there.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace kinevox::sanitize {

class LoopCrew {
  public:
    // Work in which helpers may join from invite() until close().
    struct Loop {
        std::function<void()> work;
        std::size_t wanted = 0;
        int inside = 0;
        std::exception_ptr thrown;
    };

    LoopCrew() {
        for (int n = 0; n < kHelpers; ++n) threads_.emplace_back([this] { help(); });
    }
    ~LoopCrew() {
        {
            const std::lock_guard lock(mutex_);
            ended_ = true;
        }
        invited_.notify_all();
        for (auto& thread : threads_) thread.join();
    }
    LoopCrew(const LoopCrew&) = delete;
    LoopCrew& operator=(const LoopCrew&) = delete;

    void invite(Loop& loop) {
        {
            const std::lock_guard lock(mutex_);
            open_.push_back(&loop);
        }
        invited_.notify_all();
    }
    // Waits for those inside, not for those who have not come: so loops in loops always end.
    void close(Loop& loop) {
        std::unique_lock lock(mutex_);
        std::erase(open_, &loop);
        left_.wait(lock, [&] { return loop.inside == 0; });
    }

  private:
    static constexpr int kHelpers = 3;

    void help() {
        std::unique_lock lock(mutex_);
        while (true) {
            invited_.wait(lock, [&] { return ended_ || !open_.empty(); });
            if (ended_) return;
            Loop& loop = *open_.front();
            if (--loop.wanted == 0) open_.pop_front();
            ++loop.inside;
            lock.unlock();
            std::exception_ptr thrown;
            try {
                loop.work();
            } catch (...) {
                thrown = std::current_exception();
            }
            lock.lock();
            if (thrown) loop.thrown = thrown;
            if (--loop.inside == 0) left_.notify_all();
        }
    }

    std::mutex mutex_;
    std::condition_variable invited_, left_;
    std::deque<Loop*> open_;
    bool ended_ = false;
    std::vector<std::thread> threads_;
};

inline LoopCrew& loop_crew() {
    static LoopCrew crew;  // of a test's process; the product has none
    return crew;
}

}  // namespace kinevox::sanitize
