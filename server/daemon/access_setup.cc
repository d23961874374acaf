#include "server/daemon/access_setup.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>

#include <algorithm>
#include <ctime>

#include "common/files.h"
#include "common/host_port.h"
#include "server/access/certificates.h"
#include "server/access/token_file.h"

namespace kinevox {
namespace {

absl::Status in_file(const std::filesystem::path& file, const absl::Status& status) {
    return absl::Status(status.code(), fmt::format("{}: {}; docs/access.md shows how to make one",
                                                   file.string(), std::string(status.message())));
}

// The certificate must be valid; the log warns a month before it expires.
absl::Status check_time(const std::filesystem::path& file, std::int64_t until_s) {
    const std::int64_t left_s = until_s - std::time(nullptr);
    if (left_s <= 0)
        return absl::FailedPreconditionError(
            fmt::format("{}: the certificate expired at {}; kinevox tls issue server creates a new one",
                        file.string(), to_utc(until_s)));
    if (left_s < 30 * 86'400)
        spdlog::warn("{}: the certificate expires at {}", file.string(), to_utc(until_s));
    return absl::OkStatus();
}

}  // namespace

absl::Status check_network_access(const ServerConfig& config, bool insecure) {
    const bool tls = !config.access.tls_certificate_file.empty(), tokens = !config.access.token_file.empty();
    if (is_loopback(config.listen) || insecure || (tls && tokens)) return absl::OkStatus();
    return absl::FailedPreconditionError(fmt::format(
        "listen is {}, accessible from the network, without {}; set tls_certificate_file, tls_key_file and "
        "token_file "
        "of [server] (kinevox tls init, kinevox token create; docs/access.md), or listen on 127.0.0.1",
        config.listen,
        tls      ? "tokens"
        : tokens ? "TLS"
                 : "TLS and tokens"));
}

absl::StatusOr<ApiServerOptions> api_server_options(const AccessConfig& config) {
    ApiServerOptions options;
    options.max_request_bytes =
        (config.max_request_mb << 20) + (1 << 10);  // a file of that size, and its name
    options.handshake_timeout =
        std::chrono::milliseconds(static_cast<std::int64_t>(config.handshake_timeout_s * 1000));
    if (config.tls_certificate_file.empty()) return options;
    auto certificate = read_file(config.tls_certificate_file), key = read_file(config.tls_key_file);
    if (!certificate.ok()) return certificate.status();
    if (!key.ok()) return key.status();
    const auto until_s = check_certificate(*certificate, *key);
    if (!until_s.ok()) return in_file(config.tls_certificate_file, until_s.status());
    if (absl::Status time = check_time(config.tls_certificate_file, *until_s); !time.ok()) return time;
    ServerIdentity identity{*std::move(certificate), *std::move(key), {}};
    if (!config.tls_client_ca_file.empty()) {
        auto client_ca = read_file(config.tls_client_ca_file);
        if (!client_ca.ok()) return client_ca.status();
        const auto ca_until_s = check_certificate(*client_ca, {});
        if (!ca_until_s.ok()) return in_file(config.tls_client_ca_file, ca_until_s.status());
        if (absl::Status time = check_time(config.tls_client_ca_file, *ca_until_s); !time.ok()) return time;
        identity.client_ca = *std::move(client_ca);
    }
    options.identity = std::move(identity);
    return options;
}

absl::StatusOr<std::unique_ptr<AuditLog>> open_audit_log(const AccessConfig& config) {
    if (config.audit_file) return AuditLog::open(*config.audit_file);
    auto log = AuditLog::open(in_state_folder("audit.jsonl"));
    if (log.ok()) return log;
    spdlog::warn("there is no audit log: {}", std::string(log.status().message()));
    return AuditLog::open({});
}

absl::StatusOr<std::unique_ptr<Guard>> make_guard(const AccessConfig& config, AuditLog* audit) {
    return Guard::create(config.token_file,
                         {config.max_streams, config.max_streams_per_token, config.max_requests_per_s},
                         audit);
}

void raise_open_files_limit() {
    rlimit limit{};
    if (::getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= limit.rlim_max) return;
    limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, 65536);
    ::setrlimit(RLIMIT_NOFILE, &limit);
}

GuardTimer::GuardTimer(boost::asio::io_context& io, Guard& guard) : guard_(guard), timer_(io) {
    wait();
}

void GuardTimer::wait() {
    timer_.expires_after(std::chrono::seconds(1));
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        guard_.tick();
        wait();
    });
}

void GuardTimer::stop() {
    timer_.cancel();
}

}  // namespace kinevox
