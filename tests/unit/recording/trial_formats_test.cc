// Errors, and bytes at fixed positions, which the readers in tests/integration/export_test.py do not check.
#include "server/recording/trial_formats.h"

#include <absl/strings/str_split.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "server/pose/database/bvh_import.h"
#include "tests/support/posed_trial.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

Trial posed_trial(bool gaps) {
    const testing::TemporaryFolder folder;
    EXPECT_TRUE(testing::write_posed_trial(folder.path(), gaps).ok());
    auto trial = read_trial(folder.path());
    EXPECT_TRUE(trial.ok()) << trial.status();
    return *trial;
}

TEST(TrialFormats, WritesTheTrcHeaderOfOpenSim) {
    const std::string text = trc_file(posed_trial(false), "a.trc");
    EXPECT_THAT(
        text,
        StartsWith("PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\t"
                   "OrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n50\t50\t40\t20\tmm\t50\t1\t40\n"
                   "Frame#\tTime\troot\t\t\tsacroiliac\t"));
    EXPECT_THAT(text, HasSubstr("\n\t\tX1\tY1\tZ1\tX2\t"));
    EXPECT_THAT(text, HasSubstr("\n\n1\t0.000000\t1000.000\t950.000\t500.000\t"));
}

TEST(TrialFormats, WritesCompleteC3dBlocks) {
    const auto bytes = c3d_file(posed_trial(true));
    ASSERT_TRUE(bytes.ok());
    EXPECT_EQ(bytes->size() % 512, 0u);
    EXPECT_EQ((*bytes)[0], 2);
    EXPECT_EQ((*bytes)[1], 0x50);
    EXPECT_EQ((*bytes)[512 + 3], 84);
    const int parameter_blocks = (*bytes)[512 + 2], data_block = (*bytes)[16];
    EXPECT_EQ(data_block, 2 + parameter_blocks);
    const std::size_t data = 40 * 20 * 16;
    EXPECT_EQ(bytes->size(), 512u * (data_block - 1) + (data + 511) / 512 * 512);
}

TEST(TrialFormats, NamedSubjectIsInC3dAndMot) {
    Trial trial = posed_trial(false);
    const auto c3d = c3d_file(trial), mot = mot_file(trial);
    ASSERT_TRUE(c3d.ok() && mot.ok());
    EXPECT_THAT(*c3d, Not(HasSubstr("SUBJECTS"))) << "as without names";
    EXPECT_EQ(mot->substr(0, mot->find('\n')), trial.name);
    trial.subject_name = "Jörg = 7";
    const auto named_c3d = c3d_file(trial), named_mot = mot_file(trial);
    ASSERT_TRUE(named_c3d.ok() && named_mot.ok());
    EXPECT_THAT(*named_c3d, AllOf(HasSubstr("SUBJECTS"), HasSubstr("Jörg = 7")));
    EXPECT_EQ(named_c3d->size() % 512, 0u);
    EXPECT_EQ(named_mot->substr(0, named_mot->find('\n')), trial.name + ", Jörg  7");
}

TEST(TrialFormats, WritesLongFramesInC3d) {
    Trial trial = posed_trial(false);
    trial.joints.resize(70000, trial.joints.back());
    trial.frames.resize(70000);
    trial.time_s.resize(70000);
    const auto bytes = c3d_file(trial);
    ASSERT_TRUE(bytes.ok());
    EXPECT_THAT(*bytes, HasSubstr("LONG_FRAMES"));
    EXPECT_EQ(bytes->substr(8, 2), "\xff\xff");
}

TEST(TrialFormats, BvhRefusesWithheldValues) {
    const Trial trial = posed_trial(true);
    const auto refused = bvh_file(trial, false);
    EXPECT_THAT(std::string(refused.status().message()),
                HasSubstr("pelvis_x is withheld in frame 10 (4 frames are incomplete)"));
    BvhGaps gaps;
    EXPECT_TRUE(bvh_file(trial, true, &gaps).ok());
    EXPECT_EQ(gaps.held_frames, 4);
    EXPECT_EQ(gaps.bridged_frames, 0);
    EXPECT_TRUE(bvh_file(*slice_trial(trial, 0, 9), false).ok());
    EXPECT_FALSE(bvh_file(*slice_trial(trial, 10, 12), true).ok()) << "nothing to hold";
}

TEST(TrialFormats, BvhBridgesSingleLostFrames) {
    Trial trial = posed_trial(false);
    const auto lose = [&](std::size_t frame) {
        trial.session_frames[frame] = -1;
        trial.coordinates[frame].fill(std::nan(""));
    };
    lose(7);
    lose(20);
    BvhGaps gaps;
    const auto bridged = bvh_file(trial, false, &gaps);
    ASSERT_TRUE(bridged.ok()) << bridged.status();
    EXPECT_EQ(gaps.bridged_frames, 2);
    EXPECT_EQ(gaps.held_frames, 0);
    Trial repeated = posed_trial(false);
    for (const std::size_t frame : {7, 20}) repeated.coordinates[frame] = repeated.coordinates[frame - 1];
    EXPECT_EQ(*bridged, *bvh_file(repeated, false));
    lose(21);
    EXPECT_THAT(std::string(bvh_file(trial, false).status().message()),
                HasSubstr("is lost in frame 20 (2 frames"));
}

TEST(TrialFormats, CsvHasNoColumnTwice) {
    const std::string text = csv_file(posed_trial(false));
    std::vector<std::string> columns = absl::StrSplit(text.substr(0, text.find('\n')), ',');
    EXPECT_EQ(columns.size(), 2 + 3 * kJointNames.size() + kJointAngleNames.size() + kBodyDofCount);
    std::ranges::sort(columns);
    EXPECT_EQ(std::ranges::adjacent_find(columns), columns.end());
}

// The pose library's reader is independent of the writer: it computes postures from joint positions.
TEST(TrialFormats, PoseLibraryReadsTheSamePosesFromBvh) {
    const auto text = bvh_file(posed_trial(false), false);
    ASSERT_TRUE(text.ok());
    const auto motion = parse_bvh(*text, "posed.bvh");
    ASSERT_TRUE(motion.ok()) << motion.status();
    EXPECT_EQ(motion->frames, testing::kPosedTrialFrames);
    BvhImportOptions every_frame;
    every_frame.interval_s = 0;
    const auto poses = poses_from_bvh(*motion, "posed", every_frame);
    ASSERT_TRUE(poses.ok()) << poses.status();
    ASSERT_EQ(poses->size(), static_cast<std::size_t>(testing::kPosedTrialFrames));
    constexpr double kTolerance = 0.01;
    for (int n = 0; n < testing::kPosedTrialFrames; ++n) {
        const BodyCoordinates expected = testing::posed_coordinates(n);
        for (const int dof : {kDofKneeL, kDofKneeR, kDofElbowL, kDofElbowR, kDofHipL, kDofHipR})
            EXPECT_NEAR((*poses)[n].coordinates[dof], expected[dof], kTolerance)
                << n << ' ' << kBodyDofs[dof].name;
    }
}

TEST(TrialFormats, NameMissingFiles) {
    Trial trial = posed_trial(false);
    trial.body.reset();
    EXPECT_THAT(std::string(mot_file(trial).status().message()), HasSubstr("body.toml: no such file"));
    EXPECT_THAT(std::string(bvh_file(trial, false).status().message()), HasSubstr("body.toml: no such file"));
    trial.coordinates.clear();
    EXPECT_THAT(std::string(mot_file(trial).status().message()), HasSubstr("coordinates.csv: no such file"));
    EXPECT_THAT(csv_file(trial), StartsWith("frame,time_s,root_x_m,root_y_m,root_z_m,"));
}

TEST(TrialFormats, ReportThePelvisRotation) {
    const AngleRange range = mot_pelvis_rotation(posed_trial(false));
    EXPECT_GT(range.max_rad, 3.2) << "through 180 deg without a jump";
    EXPECT_NEAR(range.max_rad - range.min_rad, 3 * 0.78, 0.3);
}

}  // namespace
}  // namespace kinevox
