// From the configuration to who may do what.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <memory>
#include <string>

#include "common/config.h"
#include "server/access/audit_log.h"
#include "server/access/guard.h"
#include "server/api/api_server.h"

namespace kinevox {

// The flag that lets everybody in.
inline constexpr const char* kServeEveryoneFlag = "--serve-everyone-without-password";

// FailedPrecondition where others than this machine's users could reach the daemon without TLS or without a
// token.
absl::Status check_reach(const ServerConfig& config, bool serve_everyone);

// Reads certificates and key. Errors name the file; a certificate that soon expires is a warning in the log.
absl::StatusOr<ApiServerOptions> api_server_options(const AccessConfig& config);

// Where the configuration names no file and the user's folder cannot be written, the log says so and there is
// none.
absl::StatusOr<std::unique_ptr<AuditLog>> open_audit_log(const AccessConfig& config);

// `audit` outlives it.
absl::StatusOr<std::unique_ptr<Guard>> make_guard(const AccessConfig& config, AuditLog* audit);

// As many open files as the system lets this process have: a connection is one.
void raise_open_files_limit();

// Calls the guard's tick() every second. Starts with the constructor, ends with stop(); both on the
// io_context's thread.
class GuardClock {
  public:
    GuardClock(boost::asio::io_context& io, Guard& guard);
    void stop();

  private:
    void wait();
    Guard& guard_;
    boost::asio::steady_timer timer_;
};

}  // namespace kinevox
