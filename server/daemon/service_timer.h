// Notifies the service manager that started the daemon: ready, status, alive or hung, stopping. Does nothing
// without one.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <string>

#include "server/daemon/watchdog.h"
#include "server/pipeline/runner.h"

namespace kinevox {

class Gpu;

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
