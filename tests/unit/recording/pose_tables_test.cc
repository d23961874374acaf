// The pose tables: columns, subjects, withheld cells.
#include <absl/strings/str_split.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <string>
#include <vector>

#include "server/recording/csv_tables.h"

namespace kinevox {
namespace {

using ::testing::Contains;
using ::testing::Not;

std::vector<std::string> cells_of(const std::string& line) {
    return absl::StrSplit(line.substr(0, line.find('\n')), ',');
}

PoseRow row_with_pose() {
    PoseRow row{.frame = 7, .time_s = 0.14, .subject_id = 2, .pose = nullptr};
    auto pose = std::make_shared<BodyPose>();
    pose->joints[*joint_index("toe_l")].withheld_reason = "joint not visible in any of 4 cameras";
    pose->joints[*joint_index("toe_l")].std_m = 0.2;
    row.pose = pose;
    return row;
}

TEST(PoseTables, HaveNoColumnTwice) {
    const PoseLines headers = pose_table_headers();
    for (std::size_t t = 0; t < headers.size(); ++t) {
        std::vector<std::string> columns = cells_of(headers[t]);
        ASSERT_GE(columns.size(), 5U);
        EXPECT_EQ(columns[2], "subject") << kPoseTableNames[t];
        std::ranges::sort(columns);
        EXPECT_EQ(std::ranges::adjacent_find(columns), columns.end()) << kPoseTableNames[t];
    }
}

TEST(PoseTables, NameAnglesAndCoordinatesApart) {
    const PoseLines headers = pose_table_headers();
    const auto angles = cells_of(headers[1]), coordinates = cells_of(headers[2]),
               uncertainty = cells_of(headers[3]);
    EXPECT_THAT(angles, Contains("hip_flexion_geometric_l_deg"));
    EXPECT_THAT(coordinates, Contains("hip_flexion_l_deg"));
    EXPECT_THAT(uncertainty, Contains("hip_flexion_geometric_l_std_deg"));
    EXPECT_THAT(uncertainty, Contains("hip_flexion_l_std_deg"));
    EXPECT_THAT(uncertainty, Contains("knee_l_camera_count"));
}

// OpenSim's pelvis is another one: y up, tilt before list before rotation. Only the MOT export converts to
// it.
TEST(PoseTables, PelvisHasNoOpenSimNames) {
    const auto columns = cells_of(pose_table_headers()[2]);
    for (const std::string_view name : kOpenSimPelvisNames)
        for (const char* unit : {"m", "deg"})
            EXPECT_THAT(columns, Not(Contains(std::string(name) + "_" + unit)));
    EXPECT_EQ(columns[3], "pelvis_x_m");
    EXPECT_THAT(columns, Contains("pelvic_obliquity_deg"));
}

TEST(PoseTables, RowsNameTheSubject) {
    const PoseLines lines = pose_table_rows(row_with_pose());
    for (std::size_t t = 0; t < lines.size(); ++t)
        EXPECT_TRUE(lines[t].starts_with("7,0.140000,2,")) << lines[t];
    const PoseLines headers = pose_table_headers();
    for (std::size_t t = 0; t + 1 < lines.size(); ++t)
        EXPECT_EQ(cells_of(lines[t]).size(), cells_of(headers[t]).size()) << kPoseTableNames[t];
}

TEST(PoseTables, WithheldCellsAreEmptyAndListed) {
    const PoseLines lines = pose_table_rows(row_with_pose());
    const auto at = [](const std::string& header, const std::string& column) {
        const auto columns = cells_of(header);
        return std::ranges::find(columns, column) - columns.begin();
    };
    const PoseLines headers = pose_table_headers();
    EXPECT_EQ(cells_of(lines[0])[at(headers[0], "toe_l_x")], "");
    EXPECT_EQ(cells_of(lines[2])[at(headers[2], "ankle_angle_l_deg")], "") << "withheld with the toe";
    EXPECT_EQ(cells_of(lines[2])[at(headers[2], "ankle_angle_r_deg")], "0.0000");
    EXPECT_EQ(cells_of(lines[3])[at(headers[3], "toe_l_std_m")], "0.20000") << "kept for withheld values";
    EXPECT_EQ(lines[4], "7,0.140000,2,toe_l,joint not visible in any of 4 cameras\n");
}

TEST(PoseTables, FrameWithoutSubjectHasOneRow) {
    const PoseLines lines = pose_table_rows({.frame = 3, .time_s = 0.06, .subject_id = 0, .pose = nullptr});
    for (std::size_t t = 0; t + 1 < lines.size(); ++t) {
        EXPECT_TRUE(lines[t].starts_with("3,0.060000,,")) << lines[t];
        EXPECT_EQ(std::ranges::count(lines[t], '\n'), 1);
    }
    EXPECT_EQ(lines[4], "3,0.060000,,pose,no pose found\n");
}

}  // namespace
}  // namespace kinevox
