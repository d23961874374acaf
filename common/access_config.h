// Access control in [server]; deploy/kinevoxd.toml documents every key, docs/access.md how they combine.
// server/config/daemon_config.h lists and reads them.
#pragma once

#include <filesystem>
#include <optional>

namespace kinevox {

struct AccessConfig {
    std::filesystem::path tls_certificate_file, tls_key_file;  // PEM, absolute; both or neither
    std::filesystem::path tls_client_ca_file;                  // PEM; empty: clients need no certificate
    std::filesystem::path token_file;                          // empty: no tokens
    std::optional<std::filesystem::path> audit_file;           // empty: off; not given: in the state folder

    // [server.limits]
    int max_request_mb = 32;
    int max_streams = 1000;
    int max_streams_per_token = 250;
    double max_requests_per_s = 200;
    double handshake_timeout_s = 10;
    bool operator==(const AccessConfig&) const = default;
};

}  // namespace kinevox
