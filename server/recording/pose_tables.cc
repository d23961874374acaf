#include "server/recording/pose_tables.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <iterator>
#include <utility>

#include "common/degrees.h"
#include "server/pose/body_model.h"

namespace kinevox {
namespace {

template <class... T>
void append(std::string& to, fmt::format_string<T...> format, T&&... values) {
    fmt::format_to(std::back_inserter(to), format, std::forward<T>(values)...);
}

// A row's first two cells; every table begins with them.
std::string row_begin(const PoseRow& row) {
    return fmt::format("{},{:.6f}", row.frame, row.time_s);
}

// The joint at a segment's far end: where it is not known, the segment's turn is not either.
constexpr std::array<std::string_view, kBodySegmentCount> kFarJoints{
    "root",   "skullbase", "head_top", "knee_l", "ankle_l", "toe_l",   "elbow_l", "wrist_l",
    "hand_l", "knee_r",    "ankle_r",  "toe_r",  "elbow_r", "wrist_r", "hand_r"};

// A degree of freedom or its deviation: metres, or degrees with so many decimals.
void append_coordinate(std::string& to, int dof, double value, int decimals_deg) {
    if (is_position(dof))
        append(to, "{:.5f}", value);
    else
        append(to, "{:.{}f}", degrees(value), decimals_deg);
}

std::array<bool, kBodyDofCount> measured_coordinates(const BodyPose& pose) {
    std::array<bool, kBodyDofCount> measured;
    measured.fill(pose.joints[*joint_index("root")].measured());
    for (int s = kThorax; s < kBodySegmentCount; ++s)
        for (int k = 0; k < kSegmentDofCount[s]; ++k)
            measured[kSegmentDof[s] + k] = pose.joints[*joint_index(kFarJoints[s])].measured();
    return measured;
}

std::string joints_header() {
    std::string text = "frame,time_s";
    for (const std::string_view joint : kJointNames) append(text, ",{0}_x,{0}_y,{0}_z", joint);
    return text + '\n';
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

std::string angles_header() {
    std::string text = "frame,time_s";
    for (const std::string_view angle : kJointAngleNames) append(text, ",{}_deg", angle);
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

std::string coordinates_header() {
    std::string text = "frame,time_s";
    for (int d = 0; d < kBodyDofCount; ++d)
        append(text, ",{}_{}", kBodyDofs[d].name, is_position(d) ? "m" : "deg");
    return text + '\n';
}

std::string coordinates_row(const PoseRow& row) {
    std::string text = row_begin(row);
    const auto measured = row.pose ? measured_coordinates(*row.pose) : std::array<bool, kBodyDofCount>{};
    for (int d = 0; d < kBodyDofCount; ++d) {
        text += ',';
        if (measured[d]) append_coordinate(text, d, row.pose->coordinates[d], 4);
    }
    return text + '\n';
}

std::string uncertainty_header() {
    std::string text = "frame,time_s";
    for (const std::string_view joint : kJointNames) append(text, ",{0}_std_m,{0}_cameras", joint);
    for (const std::string_view angle : kJointAngleNames) append(text, ",{0}_std_deg,{0}_cameras", angle);
    for (int d = 0; d < kBodyDofCount; ++d)
        append(text, ",{}_std_{}", kBodyDofs[d].name, is_position(d) ? "m" : "deg");
    return text + '\n';
}

std::string uncertainty_row(const PoseRow& row) {
    constexpr std::size_t kColumns = 2 * (kJointNames.size() + kJointAngleNames.size()) + kBodyDofCount;
    std::string text = row_begin(row);
    if (!row.pose) return text.append(kColumns, ',') + '\n';
    for (const JointEstimate& joint : row.pose->joints)
        append(text, ",{:.5f},{}", joint.std_m, joint.cameras);
    for (const AngleEstimate& angle : row.pose->angles)
        append(text, ",{:.3f},{}", degrees(angle.std_rad), angle.cameras);
    for (int d = 0; d < kBodyDofCount; ++d) {
        text += ',';
        append_coordinate(text, d, row.pose->coordinate_std[d], 3);
    }
    return text + '\n';
}

std::string withheld_rows(const PoseRow& row) {
    if (!row.pose) return row_begin(row) + ",pose,no body could be told in this frame set\n";
    std::string text;
    const auto add = [&](std::string_view name, std::string_view reason) {
        append(text, "{},{},{}\n", row_begin(row), name, csv_cell(reason));
    };
    for (std::size_t j = 0; j < kJointNames.size(); ++j)
        if (!row.pose->joints[j].measured()) add(kJointNames[j], row.pose->joints[j].withheld);
    for (std::size_t k = 0; k < kJointAngleNames.size(); ++k)
        if (!row.pose->angles[k].measured()) add(kJointAngleNames[k], row.pose->angles[k].withheld);
    return text;
}

}  // namespace

PoseLines pose_table_headers() {
    return {joints_header(), angles_header(), coordinates_header(), uncertainty_header(),
            "frame,time_s,name,reason\n"};
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
        tables.push_back({kPoseTableNames[t], std::move(texts[t])});
    return tables;
}

}  // namespace kinevox
