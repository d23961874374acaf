// The daemon's streams, as bytes of GatewayMessage. Volumes and silhouettes are passed on without decoding
// them.
#pragma once

#include <absl/status/status.h>

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <stop_token>
#include <string>

#include "client/lib/client.h"
#include "client/web/subscriptions.h"

namespace kinevox::web {

// Any thread; read() occupies its caller's.
class DaemonStreams {
  public:
    struct Listener {
        std::function<void(std::string body)> on_message;
        std::function<void(const absl::Status& connection)> on_connection;  // after every GetStatus
    };

    // `show_names`: messages contain the subjects' names.
    DaemonStreams(const client::ClientOptions& options, bool show_names);
    ~DaemonStreams();

    // Runs until `stop`; reconnects with growing pauses up to 5 s when the daemon becomes unavailable. Only
    // errors that a retry cannot change end it before: NotFound, InvalidArgument, PermissionDenied,
    // Unauthenticated.
    absl::Status read(const Topic& topic, const std::stop_token& stop, const Listener& listener);

  private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

// The daemon streams that browsers subscribe to: each is read once, on a thread of its own. Everything but
// the threads' own work happens on the gateway's thread.
class StreamPool {
  public:
    struct Options {
        std::function<void(std::function<void()>)> post;  // any thread; runs its argument on the gateway's
        // Called on the gateway's thread. `dropped_count`: messages that this one replaced before that thread
        // took them.
        std::function<void(const Topic&, std::shared_ptr<const std::string> body,
                           std::uint64_t dropped_count)>
            on_message;
        std::function<void(const Topic&, const absl::Status& reason)>
            on_end;  // the daemon ended it; not restarted
        std::function<void(const absl::Status& connection)> on_connection;  // on every change
    };

    StreamPool(DaemonStreams& daemon, Options options);
    ~StreamPool();  // joins the threads, which end at once

    // Starts and stops streams so that exactly these run.
    void set_topics(const std::set<Topic>& topics);

  private:
    struct Stream;
    void start(const Topic& topic);
    void ended(std::uint64_t id, const absl::Status& reason);

    DaemonStreams& daemon_;
    Options options_;
    std::uint64_t next_id_ = 1;
    std::map<std::uint64_t, std::unique_ptr<Stream>> streams_;  // with those stopping, until they have ended
};

}  // namespace kinevox::web
