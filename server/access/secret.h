// Tokens and their digests.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

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

}  // namespace kinevox
