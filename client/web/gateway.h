// The gateway: serves the page's files over HTTP and the daemon's streams over WebSockets. Everything runs on
// the thread that calls run(), except reading the daemon's streams.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>

#include "client/lib/client.h"
#include "client/web/http.h"

namespace kinevox::web {

struct GatewayOptions {
    std::string listen = "127.0.0.1:8090";  // HOST:PORT; port 0: a free port
    client::ClientOptions daemon;
    HttpRules rules;
    bool show_names = false;                            // of the subjects
    std::size_t max_clients = 32;                       // WebSockets
    std::size_t max_connections = 128;                  // of any kind
    std::size_t max_half_open_per_address = 16;         // connections that have not sent a request yet
    std::chrono::milliseconds request_timeout{10'000};  // for a request's header, and for the next request
    std::chrono::milliseconds idle_timeout{30'000};     // a browser that answers no ping is disconnected
    std::chrono::milliseconds write_timeout{15'000};    // of one message
};

class Gateway {
  public:
    // Listens. InvalidArgument for a malformed address, Unavailable where it cannot be bound.
    static absl::StatusOr<std::unique_ptr<Gateway>> open(const GatewayOptions& options, Pages pages);
    ~Gateway();

    std::string address() const;  // HOST:PORT
    // Runs until SIGINT, SIGTERM or stop(), then closes the WebSockets with "going away".
    void run();
    void stop();  // any thread

  private:
    struct Parts;
    explicit Gateway(std::unique_ptr<Parts> parts);
    std::unique_ptr<Parts> parts_;
};

}  // namespace kinevox::web
