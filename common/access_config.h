// [server]'s keys of who may do what; deploy/kinevoxd.toml explains every key, docs/access.md how they go
// together.
#pragma once

#include <filesystem>
#include <optional>

namespace kinevox {

class TomlTable;

struct AccessConfig {
    std::filesystem::path certificate, key;  // PEM, absolute; both or neither
    std::filesystem::path client_ca;         // PEM; empty: clients need no certificate
    std::filesystem::path tokens;            // empty: no tokens
    std::optional<std::filesystem::path>
        audit;  // empty: no file; not given: in the user's folder for programs' state

    int max_message_mb = 32;  // of a request, 1 to 1024
    int max_streams = 1000;   // of all clients together, 1 to 100000
    int max_streams_per_token = 250;
    double requests_per_s = 200;      // of one token, 1 to 1e6
    double handshake_timeout_s = 10;  // until a new connection has shaken hands, 1 to 300
    bool operator==(const AccessConfig&) const = default;
};

void read_access(const TomlTable& server, const std::filesystem::path& folder, bool check_files_exist,
                 AccessConfig& access);

}  // namespace kinevox
