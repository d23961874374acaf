// The file of tokens: who holds one, with which role and until when, and the SHA-256 of it; never the token
// itself.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "kinevox/v1/access.pb.h"
#include "server/access/secret.h"

namespace kinevox {

// Times are seconds since 1970, UTC.
struct Token {
    std::string name;  // of its holder, 1 to 64 letters, digits and . _ - @; no two that are valid share one
    v1::Role role = v1::ROLE_UNSPECIFIED;
    Digest digest{};
    std::int64_t created_s = 0;
    std::int64_t expires_s = 0;  // 0: never
    std::int64_t revoked_s = 0;  // 0: it was not
    bool valid(std::int64_t now_s) const { return revoked_s == 0 && (expires_s == 0 || now_s < expires_s); }
    bool operator==(const Token&) const = default;
};

// "2026-03-01T12:00:00Z".
std::string to_utc(std::int64_t time_s);

std::string to_toml(const std::vector<Token>& tokens);
absl::StatusOr<std::vector<Token>> parse_tokens(const std::string& text, const std::string& name_for_errors);

// PermissionDenied where others than the file's owner may read it; NotFound where it is not there.
absl::StatusOr<std::vector<Token>> read_tokens(const std::filesystem::path& file);

struct NewToken {
    std::string name;
    v1::Role role = v1::ROLE_UNSPECIFIED;
    int days = 0;  // it is valid; 0: for ever
};

// The token as its bearer needs it, which is nowhere else. A token of that name that is no longer valid makes
// room; AlreadyExists where it is valid. Makes the file. Two that change the file at once wait for each
// other.
absl::StatusOr<std::string> create_token(const std::filesystem::path& file, const NewToken& wanted,
                                         std::int64_t now_s);

// NotFound where no valid token has that name.
absl::Status revoke_token(const std::filesystem::path& file, std::string_view name, std::int64_t now_s);

}  // namespace kinevox
