// Tokens and their file: name, role, expiry and SHA-256 of each token; never the token itself.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "kinevox/v1/access.pb.h"

namespace kinevox {

using Digest = std::array<std::uint8_t, 32>;

// "kvx_" and 256 random bits as 43 letters, digits, - and _.
absl::StatusOr<std::string> make_secret();

Digest sha256(std::string_view text);

// In constant time.
bool same(const Digest& a, const Digest& b);

std::string to_hex(const Digest& digest);
// False if `text` is not 64 hexadecimal digits.
bool from_hex(std::string_view text, Digest& digest);

// Times are seconds since 1970, UTC.
struct Token {
    std::string name;  // 1 to 64 letters, digits and . _ - @; unique among valid tokens
    v1::Role role = v1::ROLE_UNSPECIFIED;
    Digest digest{};
    std::int64_t created_s = 0;
    std::int64_t expires_s = 0;  // 0: never
    std::int64_t revoked_s = 0;  // 0: not revoked
    bool valid(std::int64_t now_s) const { return revoked_s == 0 && (expires_s == 0 || now_s < expires_s); }
    bool operator==(const Token&) const = default;
};

// "2026-03-01T12:00:00Z".
std::string to_utc(std::int64_t time_s);

std::string to_toml(const std::vector<Token>& tokens);
absl::StatusOr<std::vector<Token>> parse_tokens(const std::string& text, const std::string& name_for_errors);

// PermissionDenied if others than the owner may read the file; NotFound without one.
absl::StatusOr<std::vector<Token>> read_tokens(const std::filesystem::path& file);

struct NewToken {
    std::string name;
    v1::Role role = v1::ROLE_UNSPECIFIED;
    int days = 0;  // until it expires; 0: never
};

// Returns the token itself, which is stored nowhere. Replaces an invalid token of that name; AlreadyExists
// for a valid one. Creates the file. Concurrent changes wait for each other.
absl::StatusOr<std::string> create_token(const std::filesystem::path& file, const NewToken& wanted,
                                         std::int64_t now_s);

// NotFound without a valid token of that name.
absl::Status revoke_token(const std::filesystem::path& file, std::string_view name, std::int64_t now_s);

}  // namespace kinevox
