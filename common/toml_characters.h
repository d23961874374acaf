// A check before toml++ sees a text. TOML allows characters beyond ASCII in strings and comments alone, and
// toml++ 3.3 runs into undefined behaviour where it meets some of them elsewhere
// (is_non_ascii_horizontal_whitespace() reaches
// __builtin_unreachable() for U+00A1 to U+0499 and others).
#pragma once

#include <string_view>

namespace kinevox {

// The line (from 1) of the first character beyond ASCII outside strings and comments, or behind a backslash
// and the blanks that follow it in a multi-line string; 0 if there is none. A byte order mark at the start is
// none.
int line_of_misplaced_character(std::string_view toml);

}  // namespace kinevox
