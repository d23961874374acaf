// Error messages quote what stands in files, and must still be one line that a terminal shows.
#pragma once

#include <string>

namespace kinevox {

// Control characters become blanks.
inline std::string one_line(std::string text) {
    for (char& c : text)
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
    return text;
}

}  // namespace kinevox
