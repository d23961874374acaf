// judge_faint is tried where the posed body does not fit the silhouettes, and kept where it then fits.
#include "server/quality/faint_switch.h"

#include <gtest/gtest.h>

#include <vector>

namespace kinevox::quality {
namespace {

using Change = FaintSwitch::Change;

constexpr std::int64_t kInterval_ns = 50'000'000;

class FaintSwitchTest : public ::testing::Test {
  protected:
    // The first change within `seconds` of frame sets with this residual; kNone without one.
    Change show(double residual_m, double seconds, bool explained = false) {
        const std::vector<double> residuals(residual_m > 0 ? 1 : 0, residual_m);
        for (const std::int64_t end = now_ns_ + static_cast<std::int64_t>(1e9 * seconds); now_ns_ < end;) {
            now_ns_ += kInterval_ns;
            if (const Change change = faint_.update(now_ns_, residuals, explained); change != Change::kNone)
                return change;
        }
        return Change::kNone;
    }
    FaintSwitch faint_;
    std::int64_t now_ns_ = 0;
};

TEST_F(FaintSwitchTest, KeepsWhatLowersTheResidual) {
    EXPECT_EQ(show(0.014, 10), Change::kNone);
    EXPECT_EQ(show(0.035, 3), Change::kTry);
    EXPECT_TRUE(faint_.judges_faint());
    EXPECT_EQ(show(0, 4), Change::kNone) << "no body is known yet";
    EXPECT_EQ(show(0.021, 3), Change::kKeep);
    EXPECT_TRUE(faint_.judges_faint());
    EXPECT_DOUBLE_EQ(faint_.residual_before_m(), 0.035);
    EXPECT_DOUBLE_EQ(faint_.residual_after_m(), 0.021);
    EXPECT_EQ(show(0.05, 100), Change::kNone) << "what was kept stays";
}

TEST_F(FaintSwitchTest, RevertsWithoutGainAndWaitsLongerEachTime) {
    EXPECT_EQ(show(0.025, 3), Change::kTry);
    EXPECT_EQ(show(0.024, 3), Change::kRevert);
    EXPECT_FALSE(faint_.judges_faint());
    EXPECT_EQ(show(0.025, 55), Change::kNone);
    EXPECT_EQ(show(0.025, 10), Change::kTry);
    EXPECT_EQ(show(0.03, 3), Change::kRevert);
    EXPECT_EQ(show(0.025, 110), Change::kNone);
    EXPECT_EQ(show(0.025, 15), Change::kTry);
}

TEST_F(FaintSwitchTest, RevertsIfNoPoseIsFound) {
    EXPECT_EQ(show(0.035, 3), Change::kTry);
    EXPECT_EQ(show(0, 15), Change::kRevert) << "shadows in the silhouettes hide the body";
}

TEST_F(FaintSwitchTest, StaysWhereAnotherCauseExplainsTheResidual) {
    EXPECT_EQ(show(0.035, 30, true), Change::kNone);
    EXPECT_EQ(show(0.035, 3, false), Change::kTry);
    EXPECT_TRUE(may_lack_parts({}));
    EXPECT_TRUE(may_lack_parts(std::vector<Cause>{{.cause = "silhouettes"}, {.cause = "camera_moved"}}));
    EXPECT_FALSE(may_lack_parts(std::vector<Cause>{{.cause = "camera_moved"}, {.cause = "silhouettes"}}));
    EXPECT_TRUE(may_lack_parts(std::vector<Cause>{{.cause = "camera_time"}, {.cause = "silhouettes"}}));
}

TEST_F(FaintSwitchTest, NeedsSecondsOfOneRun) {
    EXPECT_EQ(show(0.035, 1), Change::kNone);
    now_ns_ = 0;  // a loop
    EXPECT_EQ(show(0.035, 1), Change::kNone);
    EXPECT_EQ(show(0.035, 1), Change::kTry);
}

}  // namespace
}  // namespace kinevox::quality
