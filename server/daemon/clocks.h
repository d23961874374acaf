// What the daemon does by the clock, on the io_context: the log's line a second and the end of a lease.
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <memory>

#include "server/api/control_lease.h"
#include "server/pipeline/replay.h"
#include "server/pipeline/runner.h"
#include "server/pipeline/stream_hub.h"
#include "server/recording/recorder.h"
#include "server/recording/retention.h"

namespace kinevox {

// While frame sets come, one line a second with rate, losses, stage times and volume; events as they were
// published, a few a second at most. Starts with the constructor, ends with stop(). On the io_context's
// thread.
class StatusLog {
  public:
    StatusLog(boost::asio::io_context& io, const Runner& runner, StreamHub& hub);
    void stop();  // logs what is left

  private:
    void wait();
    void log_events();
    void log_figures();

    const Runner& runner_;
    StreamHub& hub_;
    boost::asio::steady_timer timer_;
    std::shared_ptr<EventMailbox> events_;
    std::uint64_t logged_results_ = 0;
};

// Deletes recordings that are too old or too many: at the start, then every ten minutes, on `files`, which
// waits for the disk. Nothing where `recorder` has no folder.
class RetentionClock {
  public:
    RetentionClock(boost::asio::io_context& io, boost::asio::any_io_executor files,
                   const RetentionLimits& limits, const Recorder& recorder, const Replay& replay,
                   StreamHub& hub);
    void stop();  // on the io_context's thread

  private:
    void look();

    const boost::asio::any_io_executor files_;
    const RetentionLimits limits_;
    const Recorder& recorder_;
    const Replay& replay_;
    StreamHub& hub_;
    boost::asio::steady_timer timer_;
};

// Publishes an event when a lease runs out.
class LeaseClock {
  public:
    LeaseClock(boost::asio::io_context& io, ControlLease& lease, StreamHub& hub);
    void stop();  // on the io_context's thread

  private:
    void rearm();

    boost::asio::io_context& io_;
    ControlLease& lease_;
    StreamHub& hub_;
    boost::asio::steady_timer timer_;
    bool stopped_ = false;
};

}  // namespace kinevox
