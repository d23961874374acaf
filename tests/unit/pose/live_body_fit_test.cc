// The fit of the body behind the capture: what it finds, when it begins, and that it lets go at once.
#include "server/pose/live_body_fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <condition_variable>

#include "common/geometry.h"
#include "tests/support/patience.h"
#include "tests/support/seen_body.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using std::chrono::steady_clock;
using ::testing::HasSubstr;

constexpr std::int64_t kFrame_ns = 100'000'000;  // ten frame sets a second

class LiveBodyFitTest : public ::testing::Test {
  protected:
    LiveBodyFitTest() {
        options_.automatic = false;
        options_.file = folder_.path() / "state/body.toml";
        options_.fit.max_frames = 10;
    }

    void make() {
        fit_ = std::make_unique<LiveBodyFit>(scene_.cameras, 10, PoseStageOptions(), options_,
                                             [this](const BodyFitProgress& progress) {
                                                 const std::scoped_lock lock(mutex_);
                                                 told_.push_back(progress);
                                                 changed_.notify_all();
                                             });
    }

    // The subject in a T-pose, arms moving a little; seconds of capture time.
    void show(double seconds) {
        for (int n = 0; n < seconds * 10; ++n, time_ns_ += kFrame_ns) {
            BodyCoordinates q = scene_.t_pose();
            q[kDofShoulderL + 1] += radians(n % 7);
            PoseObservation seen{time_ns_, {0, 0, 0.95}, scene_.see(q)};
            fit_->observe(time_ns_, &seen);
        }
    }
    void show_nobody(double seconds) {
        for (int n = 0; n < seconds * 10; ++n, time_ns_ += kFrame_ns) fit_->observe(time_ns_, nullptr);
    }
    BodyFitProgress wait_for(BodyFitState state) {
        std::unique_lock lock(mutex_);
        EXPECT_TRUE(changed_.wait_for(lock, testing::patient(std::chrono::seconds(60)),
                                      [&] { return !told_.empty() && told_.back().state == state; }));
        return told_.back();
    }

    testing::SeenBody scene_{.model = std::make_shared<BodyModel>(default_body_shape(1.60))};
    testing::TemporaryFolder folder_;
    LiveBodyFitOptions options_;
    std::mutex mutex_;
    std::condition_variable changed_;
    std::vector<BodyFitProgress> told_;
    std::int64_t time_ns_ = 5'000'000'000;
    std::unique_ptr<LiveBodyFit> fit_;  // the last member: its thread uses the others
};

TEST_F(LiveBodyFitTest, FindsStatureOnRequest) {
    make();
    ASSERT_TRUE(fit_->start(2).ok());
    EXPECT_FALSE(fit_->take_fit());
    show(2.2);
    const BodyFitProgress ready = wait_for(BodyFitState::kReady);
    ASSERT_TRUE(ready.fit);
    EXPECT_TRUE(ready.requested);
    const BodyShape& truth = scene_.model->shape();
    EXPECT_NEAR(ready.body.stature_m, truth.stature_m, 0.03) << "it began at 1.72 m";
    for (const BodyLength length : {kUpperArm, kForearm, kThigh, kShank, kShoulderHalfWidth}) {
        EXPECT_NEAR(ready.body[length], truth[length], 0.025) << kBodyLengths[length].name;
        // Held by what is usual at the least, and never as sure as if there were no other length.
        EXPECT_GT(ready.fit->lengths_std_m[length], 0.0005) << kBodyLengths[length].name;
        EXPECT_LT(ready.fit->lengths_std_m[length], 0.03) << kBodyLengths[length].name;
    }
    EXPECT_GT(ready.fit->stature_std_m, 0.001);
    EXPECT_LT(ready.fit->stature_std_m, 0.12) << "less than the prior";
    const auto fit = fit_->take_fit();
    ASSERT_TRUE(fit);
    EXPECT_EQ(fit->shape, ready.body);
    EXPECT_FALSE(fit_->take_fit()) << "returned once";
    EXPECT_EQ(ready.stored_path, options_.file);
    const auto stored = read_body_shape(options_.file);
    ASSERT_TRUE(stored.ok()) << stored.status();
    EXPECT_NEAR(stored->stature_m, fit->shape.stature_m, 1e-6);
}

TEST_F(LiveBodyFitTest, StartsAutomaticallyWithSubject) {
    options_.automatic = true;
    options_.automatic_duration_s = 1;
    make();
    show_nobody(30);
    EXPECT_EQ(fit_->progress().state, BodyFitState::kNotStarted) << "waits for a subject without limit";
    show(1.2);
    const BodyFitProgress ready = wait_for(BodyFitState::kReady);
    EXPECT_FALSE(ready.requested);
    EXPECT_TRUE(ready.stored_path.empty());
    EXPECT_FALSE(std::filesystem::exists(options_.file)) << "an automatic fit is not stored";
    show(1.5);
    EXPECT_EQ(fit_->progress().state, BodyFitState::kReady) << "once";
    time_ns_ = 0;  // the capture restarts, possibly with another subject
    show(0.5);
    EXPECT_EQ(fit_->progress().state, BodyFitState::kCollecting);
}

TEST_F(LiveBodyFitTest, RequestPreemptsAutomaticFit) {
    options_.automatic = true;
    options_.automatic_duration_s = 1;
    make();
    show(0.5);
    EXPECT_FALSE(fit_->progress().requested);
    ASSERT_TRUE(fit_->start(1).ok());
    EXPECT_TRUE(fit_->progress().requested);
    EXPECT_EQ(fit_->progress().progress, 0) << "earlier observations do not count";
    show(1.2);
    wait_for(BodyFitState::kReady);
}

TEST_F(LiveBodyFitTest, FailsWithoutSubject) {
    make();
    ASSERT_TRUE(fit_->start(1).ok());
    show_nobody(21);
    const BodyFitProgress failed = wait_for(BodyFitState::kFailed);
    EXPECT_THAT(failed.message, HasSubstr("no subject for"));
    EXPECT_EQ(failed.body, default_body_shape()) << "as it was";
}

TEST_F(LiveBodyFitTest, FailsWhenSilhouettesShowNoPerson) {
    make();
    ASSERT_TRUE(fit_->start(1).ok());
    const PoseObservation nothing{0, {0, 0, 1}, std::vector<SilhouetteRays>(4)};
    for (int n = 0; n < 12; ++n, time_ns_ += kFrame_ns) fit_->observe(time_ns_, &nothing);
    EXPECT_THAT(wait_for(BodyFitState::kFailed).message, HasSubstr("no person's pose was found in"));
    EXPECT_FALSE(fit_->take_fit());
}

TEST_F(LiveBodyFitTest, RejectsInvalidOptions) {
    make();
    for (const double seconds : {0.5, 31.0, -1.0, std::nan("")})
        EXPECT_EQ(fit_->start(seconds).code(), absl::StatusCode::kInvalidArgument) << seconds;
    fit_->close();
    EXPECT_EQ(fit_->start(2).code(), absl::StatusCode::kUnavailable);
}

TEST_F(LiveBodyFitTest, ClosesImmediately) {
    options_.fit.rounds = 1000;  // as good as for ever
    make();
    ASSERT_TRUE(fit_->start(1).ok());
    show(1.2);
    EXPECT_EQ(fit_->progress().state, BodyFitState::kFitting);
    const auto start = steady_clock::now();
    fit_.reset();
    // Its longest step is the search for a body that it knows nothing of.
    EXPECT_LT(steady_clock::now() - start, testing::patient(std::chrono::milliseconds(1500)));
}

}  // namespace
}  // namespace kinevox
