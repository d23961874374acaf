// Access control in [server] and [server.limits]; deploy/kinevoxd.toml documents every key, docs/access.md
// how they combine.
#pragma once

#include <filesystem>
#include <optional>

namespace kinevox {

class TomlTable;

struct AccessConfig {
    std::filesystem::path tls_certificate_file, tls_key_file;  // PEM, absolute; both or neither
    std::filesystem::path tls_client_ca_file;                  // PEM; empty: clients need no certificate
    std::filesystem::path token_file;                          // empty: no tokens
    std::optional<std::filesystem::path> audit_file;           // empty: off; not given: in the state folder

    int max_request_mb = 32;  // 1 to 1024
    int max_streams = 1000;   // of all clients together, 1 to 100000
    int max_streams_per_token = 250;
    double max_requests_per_s = 200;  // per token, 1 to 1e6; also the burst size
    double handshake_timeout_s = 10;  // of a new connection, 1 to 300
    bool operator==(const AccessConfig&) const = default;
};

void read_access(const TomlTable& server, const std::filesystem::path& folder, bool check_files_exist,
                 AccessConfig& access);

}  // namespace kinevox
