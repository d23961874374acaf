// Hides characters beyond ASCII from toml++ 3.3, which has undefined behaviour for some of them outside
// strings (is_non_ascii_horizontal_whitespace() ends in __builtin_unreachable() for U+00A1 to U+0499 and
// others). Private use characters of plane 15 are safe, so they replace the others while it parses.
#pragma once

#include <string>
#include <string_view>

namespace kinevox {

// UTF-8 in which U+0080 to U+FEFF have become U+F0080 to U+FFEFF, character for character, so that lines and
// columns stay; a byte order mark at the start remains. What is no valid UTF-8 is left for the parser to
// refuse.
std::string shielded(std::string_view utf8);

// The reverse.
std::string unshielded(std::string_view utf8);

}  // namespace kinevox
