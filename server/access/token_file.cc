#include "server/access/token_file.h"

#include <absl/status/status.h>
#include <absl/time/time.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/crypto.h>
#include <openssl/rand.h>
#include <openssl/sha.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <cstring>

#include "common/files.h"
#include "common/toml_reader.h"
#include "server/access/call_table.h"
#include "server/access/private_file.h"

namespace kinevox {
namespace {

constexpr const char* kTime = "%Y-%m-%dT%H:%M:%SZ";
constexpr std::size_t kMaxTokens = 1000;  // each call is compared with all of them

bool good_name(std::string_view name) {
    return !name.empty() && name.size() <= 64 && std::ranges::all_of(name, [](unsigned char c) {
        return std::isalnum(c) || c == '.' || c == '_' || c == '-' || c == '@';
    });
}

std::int64_t read_time(const TomlTable& table, const char* key) {
    const std::string text = table.text_or(key, "");
    absl::Time time;
    std::string problem;
    if (text.empty()) return 0;
    if (!absl::ParseTime(kTime, text, &time, &problem)) {
        table.fail(key,
                   fmt::format("is \"{}\", expected a time such as 2026-03-01T12:00:00Z; correct it", text));
        return 0;
    }
    return absl::ToUnixSeconds(time);
}

Token read_token(const TomlTable& table) {
    Token token;
    token.name = table.text("name");
    if (!good_name(token.name)) table.fail("name", "is not 1 to 64 letters, digits and . _ - @; correct it");
    const std::string role = table.text("role");
    token.role = role_named(role);
    if (token.role == v1::ROLE_UNSPECIFIED)
        table.fail("role", fmt::format("is \"{}\", expected one of {}; correct it", role,
                                       roles_with(v1::PERMISSION_STATUS)));
    if (!from_hex(table.text("sha256"), token.digest))
        table.fail("sha256", "is not 64 hexadecimal digits; create a new token");
    token.created_s = read_time(table, "created");
    token.expires_s = read_time(table, "expires");
    token.revoked_s = read_time(table, "revoked");
    return token;
}

// Held while the file is read, changed and written.
class FileLock {
  public:
    explicit FileLock(const std::filesystem::path& file) {
        make_private_folder(file.parent_path());
        descriptor_ = ::open((file.string() + ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
        if (descriptor_ >= 0) ::flock(descriptor_, LOCK_EX);
    }
    ~FileLock() {
        if (descriptor_ >= 0) ::close(descriptor_);
    }
    FileLock(const FileLock&) = delete;
    FileLock& operator=(const FileLock&) = delete;

  private:
    int descriptor_;
};

absl::StatusOr<std::vector<Token>> read_or_none(const std::filesystem::path& file) {
    auto tokens = read_tokens(file);
    if (absl::IsNotFound(tokens.status())) return std::vector<Token>();
    return tokens;
}

}  // namespace

std::string to_utc(std::int64_t time_s) {
    return absl::FormatTime(kTime, absl::FromUnixSeconds(time_s), absl::UTCTimeZone());
}

std::string to_toml(const std::vector<Token>& tokens) {
    std::string text =
        "# Written by `kinevox token`. Contains hashes, from which the tokens cannot be computed.\n";
    for (const Token& token : tokens) {
        text += fmt::format("\n[[token]]\nname = {}\nrole = {}\nsha256 = \"{}\"\ncreated = \"{}\"\n",
                            toml_quoted(token.name), toml_quoted(name_of(token.role)), to_hex(token.digest),
                            to_utc(token.created_s));
        if (token.expires_s) text += fmt::format("expires = \"{}\"\n", to_utc(token.expires_s));
        if (token.revoked_s) text += fmt::format("revoked = \"{}\"\n", to_utc(token.revoked_s));
    }
    return text;
}

absl::StatusOr<std::vector<Token>> parse_tokens(const std::string& text, const std::string& name_for_errors) {
    const auto document = TomlDocument::parse(text, name_for_errors);
    if (!document.ok()) return document.status();
    std::vector<Token> tokens;
    for (const TomlTable& table : (*document)->root().tables("token")) tokens.push_back(read_token(table));
    if (absl::Status status = (*document)->finish(); !status.ok()) return status;
    if (tokens.size() > kMaxTokens)
        return absl::InvalidArgumentError(fmt::format("{}: has {} tokens, more than {}; delete old ones",
                                                      name_for_errors, tokens.size(), kMaxTokens));
    return tokens;
}

absl::StatusOr<std::vector<Token>> read_tokens(const std::filesystem::path& file) {
    if (absl::Status open = check_private(file); !open.ok()) return open;
    const auto text = read_file(file);
    if (!text.ok()) return text.status();
    return parse_tokens(*text, file.string());
}

absl::StatusOr<std::string> create_token(const std::filesystem::path& file, const NewToken& wanted,
                                         std::int64_t now_s) {
    if (!good_name(wanted.name))
        return absl::InvalidArgumentError(
            fmt::format("name '{}' is not 1 to 64 letters, digits and . _ - @; give another", wanted.name));
    const FileLock lock(file);
    auto tokens = read_or_none(file);
    if (!tokens.ok()) return tokens.status();
    for (const Token& token : *tokens)
        if (token.name == wanted.name && token.valid(now_s))
            return absl::AlreadyExistsError(fmt::format(
                "{} has a valid token of that name; kinevox token revoke {}, or give another name",
                file.string(), wanted.name));
    std::erase_if(*tokens, [&](const Token& token) { return token.name == wanted.name; });
    if (tokens->size() >= kMaxTokens)
        return absl::ResourceExhaustedError(
            fmt::format("{} has {} tokens, the maximum; delete old ones", file.string(), tokens->size()));
    auto secret = make_secret();
    if (!secret.ok()) return secret.status();
    const std::int64_t expires_s = wanted.days > 0 ? now_s + std::int64_t{wanted.days} * 86'400 : 0;
    tokens->push_back({wanted.name, wanted.role, sha256(*secret), now_s, expires_s, 0});
    if (absl::Status written = write_private_file(file, to_toml(*tokens), Existing::kReplace); !written.ok())
        return written;
    return secret;
}

absl::Status revoke_token(const std::filesystem::path& file, std::string_view name, std::int64_t now_s) {
    const FileLock lock(file);
    auto tokens = read_tokens(file);
    if (!tokens.ok()) return tokens.status();
    const auto found =
        std::ranges::find_if(*tokens, [&](const Token& t) { return t.name == name && t.valid(now_s); });
    if (found == tokens->end())
        return absl::NotFoundError(
            fmt::format("{} has no valid token named '{}'; see kinevox token list", file.string(), name));
    found->revoked_s = now_s;
    return write_private_file(file, to_toml(*tokens), Existing::kReplace);
}

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
