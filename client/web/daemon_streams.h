// The daemon's streams, as bytes of GatewayMessage. Volumes and silhouettes pass as they came, unpacked
// nowhere.
#pragma once

#include <absl/status/status.h>

#include <functional>
#include <memory>
#include <stop_token>
#include <string>

#include "client/lib/client.h"
#include "client/web/wants.h"

namespace kinevox::web {

// Any thread; read() occupies its caller's.
class DaemonStreams {
  public:
    struct Listener {
        std::function<void(std::string body)> on_message;
        std::function<void(const absl::Status& link)> on_link;  // of the status alone: each time it was asked
    };

    explicit DaemonStreams(const client::ClientOptions& options);
    ~DaemonStreams();

    // Until `stop`; begins again with growing pauses up to 5 s when the daemon goes away. Ends before that
    // only with what asking again would not change: NotFound, InvalidArgument, PermissionDenied,
    // Unauthenticated.
    absl::Status read(const Topic& topic, const std::stop_token& stop, const Listener& listener);

  private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

}  // namespace kinevox::web
