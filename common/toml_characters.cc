#include <cstdint>

#include "common/toml_reader.h"

namespace kinevox {
namespace {

constexpr char32_t kFirst = 0x80, kLast = 0xFEFF, kShift = 0xF0000;
constexpr bool surrogate(char32_t c) {
    return c >= 0xD800 && c <= 0xDFFF;
}

struct Character {
    char32_t code = 0;
    std::size_t bytes = 0;  // 0: no valid UTF-8 begins here
};

Character first_character(std::string_view text) {
    const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
    const unsigned char lead = byte(0);
    if (lead < 0x80) return {lead, 1};
    const std::size_t bytes = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : 2;
    if (lead < 0xC2 || lead > 0xF4 || text.size() < bytes) return {};
    char32_t code = lead & (0xFF >> (bytes + 1));
    for (std::size_t i = 1; i < bytes; ++i) {
        if ((byte(i) & 0xC0) != 0x80) return {};
        code = code << 6 | (byte(i) & 0x3F);
    }
    constexpr char32_t kMinCode[] = {0, 0, 0x80, 0x800, 0x10000};
    if (code < kMinCode[bytes] || code > 0x10FFFF || surrogate(code)) return {};
    return {code, bytes};
}

void append(std::string& out, char32_t code) {
    const auto tail = [&](int shift) { out += static_cast<char>(0x80 | (code >> shift & 0x3F)); };
    if (code < 0x80) {
        out += static_cast<char>(code);
    } else if (code < 0x800) {
        out += static_cast<char>(0xC0 | code >> 6);
        tail(0);
    } else if (code < 0x10000) {
        out += static_cast<char>(0xE0 | code >> 12);
        tail(6), tail(0);
    } else {
        out += static_cast<char>(0xF0 | code >> 18);
        tail(12), tail(6), tail(0);
    }
}

// Every character through `change`; what is no valid UTF-8 stays.
template <typename Change>
std::string changed(std::string_view text, Change change) {
    std::string out;
    out.reserve(text.size());
    while (!text.empty()) {
        const Character c = first_character(text);
        if (c.bytes == 0)
            out += text.front();
        else
            append(out, change(c.code));
        text.remove_prefix(c.bytes == 0 ? 1 : c.bytes);
    }
    return out;
}

}  // namespace

std::string shielded(std::string_view utf8) {
    constexpr std::string_view kMark = "\xef\xbb\xbf";
    std::string out;
    if (utf8.starts_with(kMark)) {
        out = kMark;
        utf8.remove_prefix(kMark.size());
    }
    return out + changed(utf8, [](char32_t c) { return c >= kFirst && c <= kLast ? c + kShift : c; });
}

std::string unshielded(std::string_view utf8) {
    return changed(utf8, [](char32_t c) {
        const bool shield = c >= kFirst + kShift && c <= kLast + kShift && !surrogate(c - kShift);
        return shield ? c - kShift : c;
    });
}

}  // namespace kinevox
