#include "server/tools/process/pose_tables.h"

#include <array>
#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include "common/degrees.h"
#include "server/pose/body_model.h"

namespace kinevox {
namespace {

template <class... T>
void append(std::string& to, fmt::format_string<T...> format, T&&... values) {
    fmt::format_to(std::back_inserter(to), format, std::forward<T>(values)...);
}

// A row's first two cells; every table begins with them.
std::string row_begin(const PoseRow& row) { return fmt::format("{},{:.6f}", row.frame, row.time_s); }

// The joint at a segment's far end: where it is not known, the segment's turn is not either.
constexpr std::array<std::string_view, kBodySegmentCount> kFarJoints{
    "root",   "skullbase", "head_top", "knee_l",  "ankle_l", "toe_l",   "elbow_l", "wrist_l",
    "hand_l", "knee_r",    "ankle_r",  "toe_r",   "elbow_r", "wrist_r", "hand_r"};

bool is_position(int dof) { return dof < kDofRootRotation; }

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

std::string joints_table(const std::vector<PoseRow>& rows) {
    std::string text = "frame,time_s";
    for (const std::string_view joint : kJointNames) append(text, ",{0}_x,{0}_y,{0}_z", joint);
    for (const PoseRow& row : rows) {
        text += '\n' + row_begin(row);
        for (std::size_t j = 0; j < kJointNames.size(); ++j) {
            if (row.pose && row.pose->joints[j].measured()) {
                const Vec3 p = row.pose->joints[j].in_world;
                append(text, ",{:.5f},{:.5f},{:.5f}", p.x, p.y, p.z);
            } else {
                text += ",,,";
            }
        }
    }
    return text + '\n';
}

std::string angles_table(const std::vector<PoseRow>& rows) {
    std::string text = "frame,time_s";
    for (const std::string_view angle : kJointAngleNames) append(text, ",{}_deg", angle);
    for (const PoseRow& row : rows) {
        text += '\n' + row_begin(row);
        for (std::size_t k = 0; k < kJointAngleNames.size(); ++k) {
            text += ',';
            if (row.pose && row.pose->angles[k].measured())
                append(text, "{:.3f}", degrees(row.pose->angles[k].value_rad));
        }
    }
    return text + '\n';
}

std::string coordinates_table(const std::vector<PoseRow>& rows) {
    std::string text = "frame,time_s";
    for (int d = 0; d < kBodyDofCount; ++d) append(text, ",{}_{}", kBodyDofs[d].name, is_position(d) ? "m" : "deg");
    for (const PoseRow& row : rows) {
        text += '\n' + row_begin(row);
        const auto measured = row.pose ? measured_coordinates(*row.pose) : std::array<bool, kBodyDofCount>{};
        for (int d = 0; d < kBodyDofCount; ++d) {
            text += ',';
            if (!measured[d]) continue;
            append_coordinate(text, d, row.pose->coordinates[d], 4);
        }
    }
    return text + '\n';
}

std::string uncertainty_table(const std::vector<PoseRow>& rows) {
    std::string text = "frame,time_s";
    for (const std::string_view joint : kJointNames) append(text, ",{0}_std_m,{0}_cameras", joint);
    for (const std::string_view angle : kJointAngleNames) append(text, ",{0}_std_deg,{0}_cameras", angle);
    for (int d = 0; d < kBodyDofCount; ++d) append(text, ",{}_std_{}", kBodyDofs[d].name, is_position(d) ? "m" : "deg");
    constexpr std::size_t kColumns = 2 * (kJointNames.size() + kJointAngleNames.size()) + kBodyDofCount;
    for (const PoseRow& row : rows) {
        text += '\n' + row_begin(row);
        if (!row.pose) {
            text.append(kColumns, ',');
            continue;
        }
        for (const JointEstimate& joint : row.pose->joints) append(text, ",{:.5f},{}", joint.std_m, joint.cameras);
        for (const AngleEstimate& angle : row.pose->angles)
            append(text, ",{:.3f},{}", degrees(angle.std_rad), angle.cameras);
        for (int d = 0; d < kBodyDofCount; ++d) {
            text += ',';
            append_coordinate(text, d, row.pose->coordinate_std[d], 3);
        }
    }
    return text + '\n';
}

std::string withheld_table(const std::vector<PoseRow>& rows) {
    std::string text = "frame,time_s,name,reason\n";
    const auto add = [&text](const PoseRow& row, std::string_view name, std::string_view reason) {
        append(text, "{},{},{}\n", row_begin(row), name, csv_cell(reason));
    };
    for (const PoseRow& row : rows) {
        if (!row.pose) {
            add(row, "pose", "no body could be told in this frame set");
            continue;
        }
        for (std::size_t j = 0; j < kJointNames.size(); ++j)
            if (!row.pose->joints[j].measured()) add(row, kJointNames[j], row.pose->joints[j].withheld);
        for (std::size_t k = 0; k < kJointAngleNames.size(); ++k)
            if (!row.pose->angles[k].measured()) add(row, kJointAngleNames[k], row.pose->angles[k].withheld);
    }
    return text;
}

}  // namespace

std::vector<Table> pose_tables(const std::vector<PoseRow>& rows) {
    return {{"joints.csv", joints_table(rows)},
            {"angles.csv", angles_table(rows)},
            {"coordinates.csv", coordinates_table(rows)},
            {"uncertainty.csv", uncertainty_table(rows)},
            {"withheld.csv", withheld_table(rows)}};
}

}  // namespace kinevox
