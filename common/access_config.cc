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
                   fmt::format("is \"{}\", but {} does not exist; docs/access.md shows how to make it", text,
                               file.string()),
                   absl::StatusCode::kNotFound);
    return file;
}

}  // namespace

void read_access(const TomlTable& server, const std::filesystem::path& folder, bool check_files_exist,
                 AccessConfig& access) {
    access.tls_certificate_file = read_path(server, "tls_certificate_file", folder, check_files_exist);
    access.tls_key_file = read_path(server, "tls_key_file", folder, check_files_exist);
    access.tls_client_ca_file = read_path(server, "tls_client_ca_file", folder, check_files_exist);
    access.token_file = read_path(server, "token_file", folder, check_files_exist);
    if (access.tls_certificate_file.empty() != access.tls_key_file.empty())
        server.fail(access.tls_key_file.empty() ? "tls_certificate_file" : "tls_key_file",
                    "is given without the other; give tls_certificate_file and tls_key_file");
    if (!access.tls_client_ca_file.empty() && access.tls_certificate_file.empty())
        server.fail("tls_client_ca_file",
                    "is given without tls_certificate_file and tls_key_file; give those too");
    if (server.has("audit_file")) access.audit_file = read_path(server, "audit_file", folder, false);
}

}  // namespace kinevox
