// The gRPC server: all services, health and reflection.
#pragma once

#include <absl/status/statusor.h>

#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include "server/api/api_context.h"
#include "server/api/guarded_credentials.h"

namespace grpc {
class Channel;
}

namespace kinevox {

struct ApiServerOptions {
    std::optional<ServerIdentity> identity;          // none: nothing is encrypted
    int max_request_bytes = (32 << 20) + (1 << 10);  // requests are small, but for a BVH file
    // Until a new connection has shaken hands, TLS and HTTP/2; then it is closed.
    std::chrono::milliseconds handshake_timeout{10'000};
};

class ApiServer {
  public:
    // Listens on HOST:PORT; port 0 takes a free one. Unavailable: the port is taken or the host is not this
    // machine's. `api` must outlive the server. Health says NOT_SERVING until set_serving(true).
    static absl::StatusOr<std::unique_ptr<ApiServer>> listen(const std::string& address,
                                                             const ApiContext& api,
                                                             const ApiServerOptions& options = {});
    // Reached over in_process_channel() alone; for tests.
    static std::unique_ptr<ApiServer> in_process(const ApiContext& api);
    ~ApiServer();

    int port() const;
    void set_serving(bool serving);
    std::shared_ptr<grpc::Channel> in_process_channel();

    // Takes no new calls, gives those in progress so long to end, then cancels them. Once or often.
    void shutdown(std::chrono::milliseconds grace);

  private:
    struct Parts;
    explicit ApiServer(std::unique_ptr<Parts> parts);
    std::unique_ptr<Parts> parts_;
};

}  // namespace kinevox
