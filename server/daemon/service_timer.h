// Notifies the service manager that started the daemon: ready, status, alive or hung, stopping. Does nothing
// without one.
#pragma once

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <string>

#include "server/pipeline/runner.h"

namespace kinevox {

class Gpu;

// When the service manager is notified that the daemon is alive, and when that the pipeline hangs. Used by
// one thread. An idle pipeline is healthy; it hangs if it does not finish a frame set.
class Watchdog {
  public:
    enum class Signal { kNone, kAlive, kHung };

    // `interval`: within which the service manager expects a signal; zero: it does not watch.
    explicit Watchdog(std::chrono::nanoseconds interval) : interval_(interval) {}

    // Called each period(). `busy`: how long the pipeline has been busy with a frame set. kHung once when
    // that is max_busy_time() or more; then nothing until the frame set is finished.
    Signal check(std::chrono::nanoseconds busy) {
        if (interval_ <= std::chrono::nanoseconds::zero()) return Signal::kNone;
        const bool was_hung = hung_;
        hung_ = busy >= max_busy_time();
        if (!hung_) return Signal::kAlive;
        return was_hung ? Signal::kNone : Signal::kHung;
    }

    std::chrono::nanoseconds max_busy_time() const { return interval_ / 2; }
    // Four checks per interval, so that a late one is tolerated; at most one second, for the status.
    std::chrono::nanoseconds period() const {
        const std::chrono::nanoseconds second = std::chrono::seconds(1);
        return interval_ > std::chrono::nanoseconds::zero() ? std::min(second, interval_ / 4) : second;
    }

  private:
    const std::chrono::nanoseconds interval_;
    bool hung_ = false;
};

// On the io_context's thread: if that cannot run timers any more, the watchdog fires, too.
class ServiceTimer {
  public:
    // Notifies from ready() on. `gpu`: null if none is configured.
    ServiceTimer(boost::asio::io_context& io, const Runner& runner, const Gpu* gpu = nullptr);
    void ready();
    void stop();

  private:
    void wait();
    void check();

    const Runner& runner_;
    const Gpu* const gpu_;
    boost::asio::steady_timer timer_;
    Watchdog watchdog_;
    std::string status_;
};

}  // namespace kinevox
