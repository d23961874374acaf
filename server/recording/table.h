// A table as text.
#pragma once

#include <string>
#include <string_view>

namespace kinevox {

struct Table {
    std::string file_name;
    std::string text;  // header and rows
};

// Quoted where a comma, a quote or a line break demands it.
std::string csv_cell(std::string_view text);

}  // namespace kinevox
