// Reading the tables of `kinevox process`, and its errors.
#include "server/recording/trial.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <fstream>
#include <numbers>
#include <sstream>

#include "tests/support/posed_trial.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

std::string text_of(const std::filesystem::path& file) {
    std::ostringstream text;
    text << std::ifstream(file).rdbuf();
    return text.str();
}

std::string replaced(std::string text, const std::string& what, const std::string& by) {
    const std::size_t at = text.find(what);
    EXPECT_NE(at, std::string::npos) << what;
    return at == std::string::npos ? text : text.replace(at, what.size(), by);
}

std::string message_of(const std::filesystem::path& folder) {
    return std::string(read_trial(folder).status().message());
}

// A trial of joints alone, with the times of a list; also what it wrote.
std::string write_joints_at(const testing::TemporaryFolder& folder, const std::vector<double>& times_s) {
    EXPECT_TRUE(testing::write_posed_trial(folder.path(), false).ok());
    for (const char* file : {"angles.csv", "coordinates.csv", "body.toml"})
        std::filesystem::remove(folder / file);
    std::istringstream lines(text_of(folder / "joints.csv"));
    std::string line, text;
    std::getline(lines, line);
    text = line + '\n';
    for (const double time_s : times_s) {
        std::getline(lines, line);
        const std::size_t first = line.find(','), second = line.find(',', first + 1);
        text += fmt::format("{}{:.6f}{}\n", line.substr(0, first + 1), time_s, line.substr(second));
    }
    folder.write("joints.csv", text);
    return text;
}

TEST(Trial, ReadsAllTables) {
    const testing::TemporaryFolder folder;
    ASSERT_TRUE(testing::write_posed_trial(folder.path(), true).ok());
    const auto trial = read_trial(folder.path());
    ASSERT_TRUE(trial.ok()) << trial.status();
    EXPECT_EQ(trial->size(), 40u);
    EXPECT_EQ(trial->rate_hz, 50);
    EXPECT_EQ(trial->frames[7], 7);
    EXPECT_NEAR(trial->joints[0][0].x, 1, 1e-5);
    EXPECT_NEAR(trial->coordinates[3][kDofKneeL], testing::posed_coordinates(3)[kDofKneeL], 1e-6);
    EXPECT_TRUE(std::isnan(trial->joints[11][4].y));
    EXPECT_TRUE(std::isnan(trial->angles_rad[11][0]));
    EXPECT_TRUE(std::isnan(trial->coordinates[20][kDofWristR])) << "withheld with the hand";
    EXPECT_FALSE(std::isnan(trial->coordinates[20][kDofWristL]));
    EXPECT_NEAR(trial->body->stature_m, 1.8, 1e-9);
}

TEST(Trial, NeedsOnlyTheJoints) {
    const testing::TemporaryFolder folder;
    ASSERT_TRUE(testing::write_posed_trial(folder.path(), false).ok());
    for (const char* file : {"angles.csv", "coordinates.csv", "body.toml"})
        std::filesystem::remove(folder / file);
    const auto trial = read_trial(folder.path());
    ASSERT_TRUE(trial.ok()) << trial.status();
    EXPECT_TRUE(trial->coordinates.empty());
    EXPECT_TRUE(trial->angles_rad.empty());
    EXPECT_FALSE(trial->body);
}

TEST(Trial, ReportsErrorsInOneLine) {
    const testing::TemporaryFolder folder;
    ASSERT_TRUE(testing::write_posed_trial(folder.path(), false).ok());
    const std::string good = text_of(folder / "joints.csv"), angles = text_of(folder / "angles.csv");
    const std::string header = good.substr(0, good.find('\n') + 1);
    std::string nothing = header;
    for (int n = 0; n < 40; ++n)
        nothing += std::to_string(n) + "," + std::to_string(n / 50.0) + std::string(61, ',') + "\n";
    struct Case {
        const char* what;
        std::string joints, expected;
    };
    const Case cases[] = {
        {"empty", "", "joints.csv:1: column is '', expected 'frame'"},
        {"another table", angles,
         "joints.csv:1: column is 'knee_flexion_geometric_l_deg', expected 'root_x'"},
        {"no frames", header, "joints.csv: 0 frames"},
        {"one frame", good.substr(0, good.find("\n1,") + 1), "joints.csv: 1 frames"},
        {"a word", replaced(good, "\n3,0.060000,1,1", "\n3,0.060000,1,one1"),
         "joints.csv:5: root_x is 'one1"},
        {"infinite", replaced(good, "\n3,0.060000,1,1.05400", "\n3,0.060000,1,inf"),
         "joints.csv:5: root_x is 'inf'"},
        {"a cell more", replaced(good, "\n3,0.060000,", "\n3,0.060000,7,"), "joints.csv:5: 64 cells"},
        {"cut short", good.substr(0, good.size() - 30), "joints.csv:41:"},
        {"a subject twice", replaced(good, "\n3,", "\n4,"), "joints.csv:6: frame 4 has subject 1 twice"},
        {"a gap", replaced(good, "\n3,", "\n33,"), "joints.csv:5: frame 33 follows frame 2"},
        {"a half frame", replaced(good, "\n3,", "\n3.5,"), "joints.csv:5: frame is 3.5"},
        {"no time", replaced(good, "\n3,0.060000,", "\n3,,"), "joints.csv:5: time_s is missing"},
        {"a jump in time", replaced(good, "\n3,0.060000,", "\n3,0.090000,"),
         "joints.csv:6: time_s is 0.0800 after 0.0900"},
        {"half a joint", replaced(good, "\n3,0.060000,1,1.05400,", "\n3,0.060000,1,,"),
         "joints.csv:5: root lacks some of x, y, z"},
        {"a half subject", replaced(good, "\n3,0.060000,1,", "\n3,0.060000,1.5,"),
         "joints.csv:5: subject is 1.5"},
        {"nothing measured", nothing, "no joint was measured in any frame"},
    };
    for (const Case& c : cases) {
        folder.write("joints.csv", c.joints);
        EXPECT_THAT(message_of(folder.path()), AllOf(HasSubstr(c.expected), Not(HasSubstr("\n")))) << c.what;
    }
    folder.write("joints.csv", good);
    folder.write("angles.csv", replaced(angles, "\n3,", "\n9,"));
    EXPECT_THAT(message_of(folder.path()), HasSubstr("angles.csv:5: frame is 9, but 3 in joints.csv"));
    folder.write("angles.csv", angles.substr(0, angles.find("\n20,") + 1));
    EXPECT_THAT(message_of(folder.path()), HasSubstr("angles.csv: 20 frames, but joints.csv has 40"));
    EXPECT_THAT(message_of(folder / "nowhere"), HasSubstr("no such folder"));
    EXPECT_THAT(message_of(folder.path().parent_path()), HasSubstr("joints.csv: no such file"));
}

TEST(Trial, FindsRateWithMostFramesLost) {
    const testing::TemporaryFolder folder;
    std::vector<double> times_s{0};  // 50 per second
    for (int n = 0; n < 39; ++n) times_s.push_back(times_s.back() + 0.02 * (n % 3 == 0 ? 3 : 2));
    write_joints_at(folder, times_s);
    const auto trial = read_trial(folder.path());
    ASSERT_TRUE(trial.ok()) << trial.status();
    EXPECT_EQ(trial->rate_hz, 50);
    EXPECT_EQ(trial->size(), 92u);  // 39 steps: 13 times 3 + 2 + 2, and one frame
    EXPECT_FALSE(std::isnan(trial->joints[3][0].x));
    EXPECT_TRUE(std::isnan(trial->joints[4][0].x));
}

TEST(Trial, SnapsIrregularTimesToTheFrameGrid) {
    const testing::TemporaryFolder folder;
    std::vector<double> times_s{
        0};  // 20 per second; after each third frame the source lags and restarts at any time
    for (int n = 1; n < 40; ++n)
        times_s.push_back(times_s.back() + 0.05 * (n % 3 != 0 ? 1 : n / 9 % 2 == 0 ? 34.37 : 33.63));
    const std::string text = write_joints_at(folder, times_s);
    for (const double fps : {20.0, 0.0}) {
        const auto trial = read_trial(folder.path(), fps);
        ASSERT_TRUE(trial.ok()) << trial.status();
        EXPECT_NEAR(trial->rate_hz, 20, 1e-6);
        EXPECT_GT(trial->max_time_snap_s, 0.01);
        EXPECT_LE(trial->max_time_snap_s, 0.025 + 1e-6);
        EXPECT_EQ(trial->session_frames[2], 2);
        EXPECT_EQ(trial->session_frames[3], -1);
        EXPECT_EQ(trial->session_frames[36], 3) << "2 + 34.37 frames from the start, the nearest";
        EXPECT_NEAR(trial->joints[36][0].x, 1.054, 1e-5);
        EXPECT_TRUE(std::isnan(trial->joints[35][0].x));
    }
    const auto with_times = [&](const char* second, const char* third) {
        folder.write("joints.csv", replaced(replaced(text, "\n1,0.050000,", fmt::format("\n1,{},", second)),
                                            "\n2,0.100000,", fmt::format("\n2,{},", third)));
    };
    with_times("0.050500", "0.051000");
    EXPECT_TRUE(read_trial(folder.path(), 20).ok()) << "within a frame";
    with_times("0.000010", "0.000020");  // no camera is that fast
    EXPECT_THAT(message_of(folder.path()), HasSubstr("frames including lost ones, expected at most 1000000"));
}

TEST(Trial, ChoosesOneOfSeveralSubjects) {
    const testing::TemporaryFolder folder;
    ASSERT_TRUE(testing::write_posed_trial(folder.path(), false).ok());
    for (const char* file :
         {"joints.csv", "angles.csv", "coordinates.csv"}) {  // a second subject in frames 3 and 5
        std::string text = text_of(folder / file);
        for (const char* row : {"\n3,0.060000,", "\n5,0.100000,"}) {
            const std::size_t at = text.find(fmt::format("{}1,", row)), end = text.find('\n', at + 1);
            std::string second = text.substr(at, end - at);
            second.replace(std::string(row).size(), 1, "2");
            text.insert(end, second);
        }
        folder.write(file, text);
    }
    EXPECT_THAT(message_of(folder.path()), HasSubstr("joints.csv: holds subjects 1, 2; choose one"));
    const auto first = read_trial(folder.path(), 0, 1), second = read_trial(folder.path(), 0, 2);
    ASSERT_TRUE(first.ok()) << first.status();
    ASSERT_TRUE(second.ok()) << second.status();
    EXPECT_EQ(second->size(), 40u);
    EXPECT_FALSE(std::isnan(first->joints[4][0].x));
    EXPECT_TRUE(std::isnan(second->joints[4][0].x));
    EXPECT_TRUE(std::isnan(second->angles_rad[4][0]));
    EXPECT_EQ(second->joints[5][0].x, first->joints[5][0].x);
}

TEST(Trial, SliceHasOnlyItsFrames) {
    const testing::TemporaryFolder folder;
    ASSERT_TRUE(testing::write_posed_trial(folder.path(), false).ok());
    const auto trial = read_trial(folder.path());
    const auto slice = slice_trial(*trial, 10, 19);
    ASSERT_TRUE(slice.ok());
    EXPECT_EQ(slice->size(), 10u);
    EXPECT_EQ(slice->frames.front(), 10);
    EXPECT_EQ(slice->coordinates.front(), trial->coordinates[10]);
    EXPECT_EQ(slice_trial(*trial, 30, 99)->frames.back(), 39);
    EXPECT_FALSE(slice_trial(*trial, 40, 50).ok());
    EXPECT_FALSE(slice_trial(*trial, 5, 5).ok());
}

TEST(Trial, RotatesJointsAndCoordinates) {
    const testing::TemporaryFolder folder;
    ASSERT_TRUE(testing::write_posed_trial(folder.path(), false).ok());
    auto trial = read_trial(folder.path());
    rotate_trial(*trial, std::numbers::pi / 2);
    const BodyModel model(*trial->body);
    for (std::size_t n = 0; n < trial->size(); ++n) {
        const PosedBody posed = model.forward(trial->coordinates[n]);
        for (std::size_t j = 0; j < kJointNames.size(); ++j)
            EXPECT_LT(norm(posed.joints_in_world[j] - trial->joints[n][j]), 2e-5)
                << n << ' ' << kJointNames[j];
    }
    EXPECT_NEAR(trial->joints[0][0].x, 0.5, 1e-4);
}

}  // namespace
}  // namespace kinevox
