// The gRPC server: all services, health and reflection.
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include <absl/status/statusor.h>

#include "server/api/api_context.h"

namespace grpc {
class Channel;
}

namespace kinevox {

class ApiServer {
  public:
    // Listens on HOST:PORT; port 0 takes a free one. Unavailable: the port is taken or the host is not this machine's.
    // `api` must outlive the server. Health says NOT_SERVING until set_serving(true).
    static absl::StatusOr<std::unique_ptr<ApiServer>> listen(const std::string& address, const ApiContext& api);
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
