#include "client/cli/table.h"

#include <fmt/format.h>

#include <algorithm>

namespace kinevox::cli {

Table::Table(const std::vector<std::string>& headers) {
    std::vector<std::string>& row = rows_.emplace_back();
    for (const std::string& header : headers) {
        right_.push_back(header.starts_with('>'));
        row.push_back(right_.back() ? header.substr(1) : header);
    }
}

void Table::add(std::vector<std::string> cells) {
    cells.resize(right_.size());
    rows_.push_back(std::move(cells));
}

std::string Table::text() const {
    std::vector<std::size_t> widths(right_.size(), 0);
    for (const auto& row : rows_)
        for (std::size_t c = 0; c < row.size(); ++c) widths[c] = std::max(widths[c], row[c].size());
    std::string out;
    for (const auto& row : rows_) {
        std::string line;
        for (std::size_t c = 0; c < row.size(); ++c)
            line += right_[c] ? fmt::format("{}{:>{}}", c ? "  " : "", row[c], widths[c])
                              : fmt::format("{}{:<{}}", c ? "  " : "", row[c], widths[c]);
        line.erase(line.find_last_not_of(' ') + 1);
        out += (out.empty() ? "" : "\n") + line;
    }
    return out;
}

std::string count_of(std::uint64_t count, const std::string& noun) {
    return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

}  // namespace kinevox::cli
