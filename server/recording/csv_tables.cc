#include "server/recording/csv_tables.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <string_view>
#include <utility>

#include "common/files.h"
#include "common/geometry.h"
#include "common/one_line.h"

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

template <class... T>
void append(std::string& to, fmt::format_string<T...> format, T&&... values) {
    fmt::format_to(std::back_inserter(to), format, std::forward<T>(values)...);
}

constexpr std::string_view kKeyColumns = "frame,time_s,subject";

// The cells of kKeyColumns.
std::string row_begin(const PoseRow& row) {
    return fmt::format("{},{:.6f},{}", row.frame, row.time_s,
                       row.subject_id ? fmt::to_string(row.subject_id) : "");
}

// A coordinate or its std: metres, or degrees with the given number of decimals.
void append_coordinate(std::string& to, int dof, double value, int decimals_deg) {
    if (is_position(dof))
        append(to, "{:.5f}", value);
    else
        append(to, "{:.{}f}", degrees(value), decimals_deg);
}

std::string header(const std::vector<std::string>& columns) {
    return fmt::format("{}\n", fmt::join(columns, ","));
}

std::string joints_row(const PoseRow& row) {
    std::string text = row_begin(row);
    for (std::size_t j = 0; j < kJointNames.size(); ++j) {
        if (row.pose && row.pose->joints[j].measured()) {
            const Vec3 p = row.pose->joints[j].in_world;
            append(text, ",{:.5f},{:.5f},{:.5f}", p.x, p.y, p.z);
        } else {
            text += ",,,";
        }
    }
    return text + '\n';
}

std::string angles_row(const PoseRow& row) {
    std::string text = row_begin(row);
    for (std::size_t k = 0; k < kJointAngleNames.size(); ++k) {
        text += ',';
        if (row.pose && row.pose->angles[k].measured())
            append(text, "{:.3f}", degrees(row.pose->angles[k].value_rad));
    }
    return text + '\n';
}

std::string coordinates_row(const PoseRow& row) {
    std::string text = row_begin(row);
    for (int d = 0; d < kBodyDofCount; ++d) {
        text += ',';
        if (row.pose && coordinate_withheld_reason(*row.pose, d).empty())
            append_coordinate(text, d, row.pose->coordinates[d], 4);
    }
    return text + '\n';
}

std::string uncertainty_header() {
    std::string text(kKeyColumns);
    for (const std::string_view joint : kJointNames) append(text, ",{0}_std_m,{0}_camera_count", joint);
    for (const std::string_view angle : kJointAngleNames)
        append(text, ",{0}_std_deg,{0}_camera_count", angle);
    for (int d = 0; d < kBodyDofCount; ++d)
        append(text, ",{}_std_{}", kBodyDofs[d].name, is_position(d) ? "m" : "deg");
    return text + '\n';
}

std::string uncertainty_row(const PoseRow& row) {
    constexpr std::size_t kColumns = 2 * (kJointNames.size() + kJointAngleNames.size()) + kBodyDofCount;
    std::string text = row_begin(row);
    if (!row.pose) return text.append(kColumns, ',') + '\n';
    for (const JointEstimate& joint : row.pose->joints)
        append(text, ",{:.5f},{}", joint.std_m, joint.camera_count);
    for (const AngleEstimate& angle : row.pose->angles)
        append(text, ",{:.3f},{}", degrees(angle.std_rad), angle.camera_count);
    for (int d = 0; d < kBodyDofCount; ++d) {
        text += ',';
        append_coordinate(text, d, row.pose->coordinate_std[d], 3);
    }
    return text + '\n';
}

std::string withheld_rows(const PoseRow& row) {
    if (!row.pose) return row_begin(row) + ",pose,no pose found\n";
    std::string text;
    const auto add = [&](std::string_view name, std::string_view reason) {
        append(text, "{},{},{}\n", row_begin(row), name, csv_cell(reason));
    };
    for (std::size_t j = 0; j < kJointNames.size(); ++j)
        if (!row.pose->joints[j].measured()) add(kJointNames[j], row.pose->joints[j].withheld_reason);
    for (std::size_t k = 0; k < kJointAngleNames.size(); ++k)
        if (!row.pose->angles[k].measured()) add(kJointAngleNames[k], row.pose->angles[k].withheld_reason);
    return text;
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

std::vector<std::string> joint_columns() {
    std::vector<std::string> columns{"frame", "time_s", "subject"};
    for (const std::string_view joint : kJointNames)
        for (const char axis : {'x', 'y', 'z'}) columns.push_back(fmt::format("{}_{}", joint, axis));
    return columns;
}

std::vector<std::string> angle_columns() {
    std::vector<std::string> columns{"frame", "time_s", "subject"};
    for (const std::string_view angle : kJointAngleNames) columns.push_back(fmt::format("{}_deg", angle));
    return columns;
}

std::vector<std::string> coordinate_columns() {
    std::vector<std::string> columns{"frame", "time_s", "subject"};
    for (int d = 0; d < kBodyDofCount; ++d)
        columns.push_back(fmt::format("{}_{}", kBodyDofs[d].name, is_position(d) ? "m" : "deg"));
    return columns;
}

PoseLines pose_table_headers() {
    return {header(joint_columns()), header(angle_columns()), header(coordinate_columns()),
            uncertainty_header(), fmt::format("{},name,reason\n", kKeyColumns)};
}

PoseLines pose_table_rows(const PoseRow& row) {
    return {joints_row(row), angles_row(row), coordinates_row(row), uncertainty_row(row), withheld_rows(row)};
}

std::vector<Table> pose_tables(const std::vector<PoseRow>& rows) {
    PoseLines texts = pose_table_headers();
    for (const PoseRow& row : rows) {
        const PoseLines lines = pose_table_rows(row);
        for (std::size_t t = 0; t < texts.size(); ++t) texts[t] += lines[t];
    }
    std::vector<Table> tables;
    for (std::size_t t = 0; t < texts.size(); ++t)
        tables.push_back({std::string(kPoseTableNames[t]), std::move(texts[t])});
    return tables;
}

}  // namespace kinevox
