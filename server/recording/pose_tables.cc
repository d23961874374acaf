#include "server/recording/pose_tables.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <iterator>
#include <utility>

#include "common/degrees.h"

namespace kinevox {
namespace {

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
