// The daemon's streams, as bytes of GatewayMessage. Volumes and silhouettes are passed on without decoding
// them.
#pragma once

#include <absl/status/status.h>

#include <functional>
#include <memory>
#include <stop_token>
#include <string>

#include "client/lib/client.h"
#include "client/web/subscription_request.h"

namespace kinevox::web {

// Any thread; read() occupies its caller's.
class DaemonStreams {
  public:
    struct Listener {
        std::function<void(std::string body)> on_message;
        std::function<void(const absl::Status& connection)> on_connection;  // after every GetStatus
    };

    explicit DaemonStreams(const client::ClientOptions& options);
    ~DaemonStreams();

    // Runs until `stop`; reconnects with growing pauses up to 5 s when the daemon becomes unavailable. Only
    // errors that a retry cannot change end it before: NotFound, InvalidArgument, PermissionDenied,
    // Unauthenticated.
    absl::Status read(const Topic& topic, const std::stop_token& stop, const Listener& listener);

  private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

}  // namespace kinevox::web
