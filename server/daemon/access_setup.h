// Sets access control up by the configuration.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <memory>
#include <string>

#include "server/access/audit_log.h"
#include "server/access/guard.h"
#include "server/api/api_server.h"
#include "server/config/daemon_config.h"

namespace kinevox {

// Serves the network without TLS and tokens.
inline constexpr const char* kInsecureFlag = "--insecure";

// FailedPrecondition if the daemon would be accessible from the network without TLS or without tokens.
absl::Status check_network_access(const ServerConfig& config, bool insecure);

// Reads certificates and key. Errors name the file; a certificate that expires soon is a warning in the log.
absl::StatusOr<ApiServerOptions> api_server_options(const AccessConfig& config);

// Without a configured file, and if the state folder cannot be written, the log has a warning and there is no
// audit log.
absl::StatusOr<std::unique_ptr<AuditLog>> open_audit_log(const AccessConfig& config);

// `audit` outlives it.
absl::StatusOr<std::unique_ptr<Guard>> make_guard(const AccessConfig& config, AuditLog* audit);

// To the maximum of this process: each connection is an open file.
void raise_open_files_limit();

// Calls the guard's tick() every second. Starts with the constructor, ends with stop(); both on the
// io_context's thread.
class GuardTimer {
  public:
    GuardTimer(boost::asio::io_context& io, Guard& guard);
    void stop();

  private:
    void wait();
    Guard& guard_;
    boost::asio::steady_timer timer_;
};

}  // namespace kinevox
