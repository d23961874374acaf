#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "common/body_pose.h"
#include "tests/support/test_data.h"

namespace kinevox {
namespace {

constexpr double kDegrees = 180 / 3.14159265358979323846;

// Rows of numbers below one line of names.
std::vector<std::vector<double>> read_csv(const std::filesystem::path& file, std::string& header) {
    std::ifstream in(file);
    std::getline(in, header);
    std::vector<std::vector<double>> rows;
    for (std::string line; std::getline(in, line);) {
        std::istringstream cells(line);
        rows.emplace_back();
        for (std::string cell; std::getline(cells, cell, ',');) rows.back().push_back(std::stod(cell));
    }
    return rows;
}

TEST(JointAngles, MatchGroundTruth) {
    KINEVOX_REQUIRE_DATA(studio, "studio");
    for (const char* sequence : {"walk", "gesture", "signal", "sprint"}) {
        std::string joint_names, angle_names, expected_joints = "frame,time_s",
                                              expected_angles = "frame,time_s";
        const auto joints = read_csv(studio / sequence / "truth/joints.csv", joint_names);
        const auto angles = read_csv(studio / sequence / "truth/angles.csv", angle_names);
        for (auto name : kJointNames)
            for (const char* axis : {"_x", "_y", "_z"}) expected_joints += "," + std::string(name) + axis;
        for (auto name : kJointAngleNames) {  // the shared truth has the names from before "_geometric"
            std::string old(name);
            expected_angles +=
                "," + old.erase(old.find("_geometric"), std::string("_geometric").size()) + "_deg";
        }
        EXPECT_EQ(joint_names, expected_joints);
        EXPECT_EQ(angle_names, expected_angles);
        ASSERT_EQ(joints.size(), angles.size());
        ASSERT_GT(joints.size(), 50u);
        for (std::size_t row = 0; row < joints.size(); ++row) {
            std::array<Vec3, kJointNames.size()> positions;
            for (std::size_t j = 0; j < positions.size(); ++j)
                positions[j] = {joints[row][2 + 3 * j], joints[row][3 + 3 * j], joints[row][4 + 3 * j]};
            const auto computed = joint_angles(positions);
            // The joints in the table are rounded to 10 um: up to 0.004 degrees on a forearm.
            for (std::size_t a = 0; a < computed.size(); ++a)
                EXPECT_NEAR(computed[a] * kDegrees, angles[row][2 + a], 6e-3)
                    << sequence << " frame " << row << " " << kJointAngleNames[a];
        }
    }
}

TEST(JointAngles, MissingJointsGiveNanWhereNeeded) {
    std::array<Vec3, kJointNames.size()> joints;
    for (std::size_t j = 0; j < joints.size(); ++j)
        joints[j] = {0.1 * static_cast<double>(j * j), 0.3 * static_cast<double>(j),
                     1.0 + 0.05 * static_cast<double>(j)};
    joints[6] = {std::nan(""), 0, 0};  // wrist_l
    const auto angles = joint_angles(joints);
    for (std::size_t a = 0; a < angles.size(); ++a)
        EXPECT_EQ(std::isnan(angles[a]), kJointAngleNames[a] == "elbow_flexion_geometric_l")
            << kJointAngleNames[a];
}

}  // namespace
}  // namespace kinevox
