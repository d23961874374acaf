// The gRPC server: all services, health and reflection.
#pragma once

#include <absl/status/statusor.h>

#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include "server/api/api_context.h"
#include "server/api/call_access.h"

namespace grpc {
class Channel;
}

namespace kinevox {

struct ApiServerOptions {
    std::optional<ServerIdentity> identity;          // none: unencrypted
    int max_request_bytes = (32 << 20) + (1 << 10);  // requests are small, except BVH files
    // For the TLS and HTTP/2 handshake of a new connection, which is closed otherwise.
    std::chrono::milliseconds handshake_timeout{10'000};
};

class ApiServer {
  public:
    // Listens on HOST:PORT; port 0: a free one. Unavailable: the port is in use, or the host is not this
    // machine. `api` must outlive the server. The health service reports NOT_SERVING until set_serving(true).
    static absl::StatusOr<std::unique_ptr<ApiServer>> listen(const std::string& address,
                                                             const ApiContext& api,
                                                             const ApiServerOptions& options = {});
    // Accessible through in_process_channel() only; for tests.
    static std::unique_ptr<ApiServer> in_process(const ApiContext& api);
    ~ApiServer();

    int port() const;
    void set_serving(bool serving);
    std::shared_ptr<grpc::Channel> in_process_channel();

    // Rejects new calls, waits `grace` for those in progress, then cancels them. Idempotent.
    void shutdown(std::chrono::milliseconds grace);

  private:
    struct Parts;
    explicit ApiServer(std::unique_ptr<Parts> parts);
    std::unique_ptr<Parts> parts_;
};

}  // namespace kinevox
