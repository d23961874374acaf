#include "common/access_config.h"

#include <fmt/format.h>

#include <string>
#include <system_error>

#include "common/toml_reader.h"

namespace kinevox {
namespace {

std::filesystem::path read_path(const TomlTable& table, const char* key, const std::filesystem::path& folder,
                                bool must_exist) {
    const std::string text = table.text_or(key, "");
    if (text.empty()) return {};
    const std::filesystem::path file = (folder / text).lexically_normal();
    std::error_code ignored;
    if (must_exist && !std::filesystem::exists(file, ignored))
        table.fail(key,
                   fmt::format("is \"{}\", but {} does not exist; docs/access.md tells how to make it", text,
                               file.string()),
                   absl::StatusCode::kNotFound);
    return file;
}

}  // namespace

void read_access(const TomlTable& server, const std::filesystem::path& folder, bool check_files_exist,
                 AccessConfig& access) {
    access.certificate = read_path(server, "certificate", folder, check_files_exist);
    access.key = read_path(server, "key", folder, check_files_exist);
    access.client_ca = read_path(server, "client_ca", folder, check_files_exist);
    access.tokens = read_path(server, "tokens", folder, check_files_exist);
    if (access.certificate.empty() != access.key.empty())
        server.fail(access.key.empty() ? "certificate" : "key",
                    "is given without the other; give certificate and key");
    if (!access.client_ca.empty() && access.certificate.empty())
        server.fail("client_ca", "is given without certificate and key; give those too");
    if (server.has("audit")) access.audit = read_path(server, "audit", folder, false);
    const TomlTable limits = server.table_or_empty("limits");
    const auto count = [&](const char* key, int& value, int highest) {
        value = static_cast<int>(limits.integer_or(key, value, 1, highest));
    };
    count("max_message_mb", access.max_message_mb, 1024);
    count("max_streams", access.max_streams, 100'000);
    count("max_streams_per_token", access.max_streams_per_token, 100'000);
    access.requests_per_s = limits.number_or("requests_per_s", access.requests_per_s, {1, 1e6});
    access.handshake_timeout_s =
        limits.number_or("handshake_timeout_s", access.handshake_timeout_s, {1, 300});
}

}  // namespace kinevox
