// What the daemon does at intervals, on the io_context: the status line in the log, retention and expired
// leases.
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <memory>

#include "server/api/control_lease.h"
#include "server/events/event_log.h"
#include "server/pipeline/replay.h"
#include "server/pipeline/runner.h"
#include "server/pipeline/stream_hub.h"
#include "server/recording/recorder.h"
#include "server/recording/recording_list.h"

namespace kinevox {

// While frame sets arrive, one line per second with rate, losses, stage times, volume and subscribers; events
// as they are published, at most a few per second. From the constructor to stop(). On the io_context's
// thread.
class StatusLog {
  public:
    StatusLog(boost::asio::io_context& io, const Runner& runner, StreamHub& hub);
    void stop();  // logs the remaining events

  private:
    void wait();
    void log_events();
    void log_statistics();

    const Runner& runner_;
    StreamHub& hub_;
    boost::asio::steady_timer timer_;
    std::shared_ptr<EventMailbox> events_;
    std::uint64_t logged_results_ = 0;
};

// Deletes recordings beyond the limits: at the start, then every ten minutes, on `files`, which waits for the
// disk. Does nothing if `recorder` has no folder.
class RetentionTimer {
  public:
    RetentionTimer(boost::asio::io_context& io, boost::asio::any_io_executor files,
                   const RetentionLimits& limits, const Recorder& recorder, const Replay& replay,
                   EventLog& events);
    void stop();  // on the io_context's thread

  private:
    void apply();

    const boost::asio::any_io_executor files_;
    const RetentionLimits limits_;
    const Recorder& recorder_;
    const Replay& replay_;
    EventLog& events_;
    boost::asio::steady_timer timer_;
};

// Publishes an event when a lease expires.
class LeaseTimer {
  public:
    LeaseTimer(boost::asio::io_context& io, ControlLease& lease, EventLog& events);
    void stop();  // on the io_context's thread

  private:
    void rearm();

    boost::asio::io_context& io_;
    ControlLease& lease_;
    EventLog& events_;
    boost::asio::steady_timer timer_;
    bool stopped_ = false;
};

}  // namespace kinevox
