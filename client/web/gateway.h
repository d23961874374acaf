// The gateway: serves the page's files over HTTP and the daemon's streams over WebSockets. All of it runs on
// the thread that calls run(); only reading the daemon's streams has threads of its own.
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
    std::string listen = "127.0.0.1:8090";  // HOST:PORT; port 0 takes a free one
    client::ClientOptions daemon;
    HttpRules rules;
    std::size_t max_browsers = 32;                      // WebSockets at a time
    std::size_t max_connections = 128;                  // of any kind
    std::chrono::milliseconds request_timeout{10'000};  // for a request's head, and for the next one
    std::chrono::milliseconds silence{
        30'000};                              // a browser that does not even answer a ping is gone after this
    std::chrono::milliseconds stuck{15'000};  // so long for one message, then it is gone, too
};

class Gateway {
  public:
    // Listens. InvalidArgument for an address that is none, Unavailable for one that cannot be had.
    static absl::StatusOr<std::unique_ptr<Gateway>> open(const GatewayOptions& options, Pages pages);
    ~Gateway();

    std::string address() const;  // HOST:PORT
    // Until SIGINT, SIGTERM or stop(); browsers are told that it goes away.
    void run();
    void stop();  // any thread

  private:
    struct Parts;
    explicit Gateway(std::unique_ptr<Parts> parts);
    std::unique_ptr<Parts> parts_;
};

}  // namespace kinevox::web
