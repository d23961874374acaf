#include "server/access/secret.h"

#include <absl/status/status.h>
#include <fmt/format.h>
#include <openssl/crypto.h>
#include <openssl/rand.h>
#include <openssl/sha.h>

#include <charconv>

namespace kinevox {

absl::StatusOr<std::string> make_secret() {
    std::array<std::uint8_t, 32> bits;
    if (RAND_bytes(bits.data(), static_cast<int>(bits.size())) != 1)
        return absl::UnavailableError("this machine gives no random numbers; try again later");
    constexpr char kLetters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
    std::string text = "kvx_";
    std::uint32_t held = 0;
    int count = 0;
    for (const std::uint8_t byte : bits) {
        held = held << 8 | byte;
        for (count += 8; count >= 6; count -= 6) text += kLetters[held >> (count - 6) & 63];
    }
    text += kLetters[held << (6 - count) & 63];  // 256 is 42 letters and 4 bits
    return text;
}

Digest sha256(std::string_view text) {
    Digest digest;
    SHA256(reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data());
    return digest;
}

bool same(const Digest& a, const Digest& b) {
    return CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

std::string to_hex(const Digest& digest) {
    std::string text;
    for (const std::uint8_t byte : digest) text += fmt::format("{:02x}", byte);
    return text;
}

bool from_hex(std::string_view text, Digest& digest) {
    if (text.size() != 2 * digest.size()) return false;
    for (std::size_t i = 0; i < digest.size(); ++i) {
        const char* begin = text.data() + 2 * i;
        const auto [end, error] = std::from_chars(begin, begin + 2, digest[i], 16);
        if (error != std::errc{} || end != begin + 2) return false;
    }
    return true;
}

}  // namespace kinevox
