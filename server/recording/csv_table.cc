#include "server/recording/csv_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>

#include "common/atomic_file.h"
#include "common/one_line.h"
#include "server/recording/table.h"

namespace kinevox {
namespace {

constexpr std::size_t kMaxBytes = std::size_t{1} << 30;  // hours of capture
constexpr const char* kRemedy = "rerun `kinevox process`";

// Removes the text up to a delimiter (or the end) from the front of `rest`.
std::string_view take(std::string_view& rest, char delimiter) {
    const std::size_t end = rest.find(delimiter);
    const std::string_view taken = rest.substr(0, end);
    rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + 1);
    return taken;
}

std::string_view take_line(std::string_view& rest) {
    std::string_view line = take(rest, '\n');
    if (line.ends_with('\r')) line.remove_suffix(1);
    return line;
}

std::string quoted(std::string_view text) {
    constexpr std::size_t kMaxLength = 40;
    return one_line(fmt::format("'{}{}'", text.substr(0, kMaxLength), text.size() > kMaxLength ? "..." : ""));
}

std::size_t count_cells(std::string_view line) {
    return 1 + static_cast<std::size_t>(std::count(line.begin(), line.end(), ','));
}

absl::Status check_header(std::string_view line, std::span<const std::string> columns,
                          const std::string& file) {
    const std::size_t found = count_cells(line);
    for (const std::string& expected : columns) {
        const std::string_view name = take(line, ',');
        if (name != expected)
            return absl::InvalidArgumentError(
                fmt::format("{}:1: column is {}, expected '{}'; {}", file, quoted(name), expected, kRemedy));
    }
    if (found != columns.size())
        return absl::InvalidArgumentError(
            fmt::format("{}:1: {} columns, expected {}; {}", file, found, columns.size(), kRemedy));
    return absl::OkStatus();
}

}  // namespace

absl::StatusOr<CsvTable> read_csv_table(const std::filesystem::path& path,
                                        std::span<const std::string> columns) {
    auto text = read_file(path, kMaxBytes);
    if (!text.ok()) return text.status();
    CsvTable table;
    table.file = path.string();
    table.columns = columns.size();
    std::string_view rest = *text;
    if (absl::Status good = check_header(take_line(rest), columns, table.file); !good.ok()) return good;
    for (std::size_t number = 2; !rest.empty(); ++number) {
        std::string_view line = take_line(rest);
        if (const std::size_t found = count_cells(line); found != columns.size())
            return absl::InvalidArgumentError(
                fmt::format("{}:{}: {} cells, expected {}; the file is damaged: {}", table.file, number,
                            found, columns.size(), kRemedy));
        table.lines.push_back(number);
        for (const std::string& column : columns) {
            const std::string_view cell = take(line, ',');
            double value = std::numeric_limits<double>::quiet_NaN();
            if (!cell.empty()) {
                const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
                if (error != std::errc() || end != cell.data() + cell.size() || !std::isfinite(value))
                    return absl::InvalidArgumentError(
                        fmt::format("{}:{}: {} is {}, expected a number or an empty cell; {}", table.file,
                                    number, column, quoted(cell), kRemedy));
            }
            table.cells.push_back(value);
        }
    }
    return table;
}

std::string csv_cell(std::string_view text) {
    if (text.find_first_of(",\"\n\r") == std::string_view::npos) return std::string(text);
    std::string cell = "\"";
    for (const char c : text) {
        if (c == '"') cell += '"';
        cell += c;
    }
    return cell + '"';
}

}  // namespace kinevox
