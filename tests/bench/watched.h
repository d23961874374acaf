// What one subscriber of a stream got, and how late.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

namespace kinevox::bench {

// When the messages are counted.
inline std::atomic<bool> counting = false;

// On the thread that reads the messages; looked at when nothing is counted any more.
struct Watched {
    std::uint64_t messages = 0, missed = 0, gaps = 0;
    std::vector<float> behind_ms, delivery_ms;  // since the capture, since the daemon had it ready
    std::atomic<bool> ended = false;
    std::string why;  // of an end that was not asked for

    template <typename Message>
    void take(const Message& message) {
        const auto& header = message.header();
        if (counting) {
            ++messages;
            missed += header.missed_count();
            if (header.sequence() > last_ + 1 && last_ != 0) gaps += header.sequence() - last_ - 1;
            behind_ms.push_back(ms_since(header.capture_time_ns()));
            delivery_ms.push_back(ms_since(header.publish_time_ns()));
        }
        last_ = header.sequence();
    }

  private:
    static float ms_since(std::int64_t utc_ns) {
        const std::int64_t now = std::chrono::duration_cast<std::chrono::nanoseconds>(
                                     std::chrono::system_clock::now().time_since_epoch())
                                     .count();
        return static_cast<float>(1e-6 * static_cast<double>(now - utc_ns));
    }

    std::uint64_t last_ = 0;
};

// One subscriber on a connection of its own.
class Watcher {
  public:
    virtual ~Watcher() = default;
    virtual void stop() = 0;
    Watched watched;
};

}  // namespace kinevox::bench
