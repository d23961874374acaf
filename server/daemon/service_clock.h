// What the daemon tells the service manager that started it: ready, what it does, alive or hung, stopping.
// Tells nothing where none did.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <string>

#include "server/daemon/watchdog.h"
#include "server/pipeline/runner.h"

namespace kinevox {

class Gpu;

// On the io_context's thread: a thread that cannot run timers any more feeds no watchdog either.
class ServiceClock {
  public:
    // Begins to tell with ready(). `gpu`: null where none is asked for.
    ServiceClock(boost::asio::io_context& io, const Runner& runner, const Gpu* gpu = nullptr);
    void ready();
    void stop();

  private:
    void wait();
    void look();

    const Runner& runner_;
    const Gpu* const gpu_;
    boost::asio::steady_timer timer_;
    Watchdog watchdog_;
    std::string told_;
};

}  // namespace kinevox
