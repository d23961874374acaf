// Which of two runs through a session has the better poses.
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "server/tools/process/pose_pass.h"

namespace kinevox {
namespace {

// Poses of one subject with this residual, `withheld` joints of each missing.
void add_poses(std::vector<PoseRow>& rows, std::uint32_t subject_id, int count, double residual_m,
               int withheld = 0) {
    auto pose = std::make_shared<BodyPose>();
    pose->contour_residual_rms_m = residual_m;
    for (int j = 0; j < withheld; ++j) pose->joints[j].withheld_reason = "not visible";
    for (int n = 0; n < count; ++n)
        rows.push_back({static_cast<std::uint64_t>(n), n / 30.0, subject_id, pose});
}

TEST(PoseFitSummary, IsEmptyWithoutPoses) {
    const PoseFitSummary none = summarize(std::vector<PoseRow>{{0, 0, 0, nullptr}});
    EXPECT_FALSE(none.contour_residual_m || none.max_contour_residual_m);
    EXPECT_EQ(none.measured_joints, 0);
    EXPECT_FALSE(is_better(none, none));
}

TEST(PoseFitSummary, ReportsSubjectThatFitsWorst) {
    std::vector<PoseRow> rows;
    add_poses(rows, 1, 30, 0.008);
    add_poses(rows, 2, 30, 0.010);
    add_poses(rows, 3, 20, 0.018);
    add_poses(rows, 4, 5, 0.030);  // there too briefly
    const PoseFitSummary fit = summarize(rows);
    EXPECT_NEAR(*fit.max_contour_residual_m, 0.018, 1e-9);
    EXPECT_NEAR(*fit.contour_residual_m, (30 * 0.008 + 30 * 0.010 + 20 * 0.018 + 5 * 0.030) / 85, 1e-9);
    EXPECT_EQ(fit.measured_joints, 85 * static_cast<int>(rows.front().pose->joints.size()));
}

TEST(PoseFitSummary, PrefersSmallerResidualUnlessJointsAreMissing) {
    std::vector<PoseRow> plain, faint, withheld;
    add_poses(plain, 1, 30, 0.016);
    add_poses(faint, 1, 30, 0.011);
    add_poses(withheld, 1, 30, 0.011, 4);
    EXPECT_TRUE(is_better(summarize(faint), summarize(plain)));
    EXPECT_FALSE(is_better(summarize(plain), summarize(faint)));
    EXPECT_FALSE(is_better(summarize(plain), summarize(plain)));
    EXPECT_FALSE(is_better(summarize(withheld), summarize(plain)));
}

}  // namespace
}  // namespace kinevox
