#include <absl/status/status.h>
#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "client/lib/client.h"
#include "common/host_port.h"

namespace kinevox::client {
namespace {

constexpr std::size_t kMaxFile = 1 << 20;

absl::StatusOr<std::string> contents(const std::string& file, const char* what) {
    std::error_code error;
    std::ifstream in(file, std::ios::binary);
    if (!in || std::filesystem::is_directory(file, error))
        return absl::NotFoundError(
            fmt::format("{} '{}' cannot be read; correct the path or its permissions", what, file));
    std::string text(kMaxFile + 1, '\0');
    in.read(text.data(), static_cast<std::streamsize>(text.size()));
    text.resize(static_cast<std::size_t>(in.gcount()));
    if (text.size() > kMaxFile)
        return absl::InvalidArgumentError(
            fmt::format("{} '{}' is larger than 1 MB; give another file", what, file));
    return text;
}

// The contents of a PEM file that has a block of this kind ("CERTIFICATE", "PRIVATE KEY").
absl::StatusOr<std::string> pem(const std::string& file, const char* what, const char* kind) {
    auto text = contents(file, what);
    if (!text.ok()) return text;
    if (text->find("-----BEGIN ") == std::string::npos ||
        text->find(fmt::format("{}-----", kind)) == std::string::npos)
        return absl::InvalidArgumentError(
            fmt::format("{} '{}' holds no {} in PEM; `kinevox tls` makes one", what, file, kind));
    return text;
}

absl::StatusOr<std::string> token(const std::string& file) {
    auto text = contents(file, "the token file");
    if (!text.ok()) return text;
    const std::size_t begin = text->find_first_not_of(" \t\r\n");
    if (begin == std::string::npos)
        return absl::InvalidArgumentError(fmt::format(
            "the token file '{}' is empty; write the output of `kinevox token create` to it", file));
    std::string line = text->substr(begin, text->find_first_of(" \t\r\n", begin) - begin);
    // Other characters are not allowed in an HTTP header and would only show as a failed connection.
    for (const char c : line)
        if (c < 0x21 || c > 0x7e)
            return absl::InvalidArgumentError(
                fmt::format("the token file '{}' does not contain a token; its first line is the output of "
                            "`kinevox token create`",
                            file));
    return line;
}

bool is_on_this_machine(const std::string& server) {
    return is_loopback(server) || server.starts_with("unix:");
}

}  // namespace

absl::StatusOr<Security> read_security(const SecurityFiles& files, const std::string& server) {
    Security out;
    out.server_name = files.server_name;
    out.tls = files.tls || !files.ca.empty() || !files.certificate.empty() || !files.key.empty() ||
              !files.server_name.empty();
    if (files.certificate.empty() != files.key.empty())
        return absl::InvalidArgumentError(
            files.key.empty()
                ? fmt::format("the certificate '{}' needs its key; give --key", files.certificate)
                : fmt::format("the key '{}' needs its certificate; give --certificate", files.key));
    const auto read = [](std::string& into, absl::StatusOr<std::string> from) {
        if (from.ok()) into = *std::move(from);
        return from.status();
    };
    absl::Status status;
    if (!files.ca.empty())
        status.Update(read(out.ca_pem, pem(files.ca, "the CA certificate", "CERTIFICATE")));
    if (!files.certificate.empty()) {
        status.Update(read(out.certificate_pem, pem(files.certificate, "the certificate", "CERTIFICATE")));
        status.Update(read(out.key_pem, pem(files.key, "the key", "PRIVATE KEY")));
    }
    if (!files.token.empty()) status.Update(read(out.token, token(files.token)));
    if (!status.ok()) return status;
    if (!out.token.empty() && !out.tls && !is_on_this_machine(server))
        return absl::InvalidArgumentError(
            fmt::format("the token would be sent to {} unencrypted; add --tls, or --ca FILE", server));
    return out;
}

}  // namespace kinevox::client
