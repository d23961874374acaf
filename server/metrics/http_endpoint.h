// A small HTTP server for monitoring: GET /metrics only.
#pragma once

#include <absl/status/statusor.h>

#include <functional>
#include <memory>
#include <string>

#include "server/metrics/metrics_text.h"

namespace kinevox::metrics {

// Has its own thread, which calls `metrics`; clients that read slowly or not at all do not block others.
class HttpEndpoint {
  public:
    using Metrics = std::function<std::string(Format)>;

    // `address` is HOST:PORT, port 0 takes a free one. Unavailable, with the remedy, if it cannot listen
    // there.
    static absl::StatusOr<std::unique_ptr<HttpEndpoint>> listen(const std::string& address, Metrics metrics);
    ~HttpEndpoint();  // ends the thread
    HttpEndpoint(const HttpEndpoint&) = delete;
    HttpEndpoint& operator=(const HttpEndpoint&) = delete;

    int port() const;

  private:
    struct Parts;
    explicit HttpEndpoint(std::unique_ptr<Parts> parts);
    std::unique_ptr<Parts> parts_;
};

}  // namespace kinevox::metrics
