// The fit of the body behind the capture: what it finds, when it begins, and that it lets go at once.
#include "server/pose/live_body_fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <condition_variable>
#include <optional>

#include "common/geometry.h"
#include "server/pose/pose_tracker.h"
#include "tests/support/patience.h"
#include "tests/support/seen_body.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using std::chrono::steady_clock;
using ::testing::ElementsAre;
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
                                             LiveBodyFit::Observers{[this](const auto& all) {
                                                                        const std::scoped_lock lock(mutex_);
                                                                        told_.push_back(all.front());
                                                                        changed_.notify_all();
                                                                    },
                                                                    {}});
    }

    // Where only the state counts, not the body.
    void fit_roughly() { options_.fit.max_frames = 4, options_.fit.rounds = 1; }

    // The subject in a T-pose, arms moving a little; seconds of capture time.
    void show(double seconds, std::uint32_t id = 1) {
        for (int n = 0; n < seconds * 10; ++n, time_ns_ += kFrame_ns) {
            BodyCoordinates q = scene_.t_pose();
            q[kDofShoulderL + 1] += radians(n % 7);
            PoseObservation seen{time_ns_, {0, 0, 0.95}, scene_.see(q)};
            std::optional<BodyPosture> posture;
            if (tracker_)
                if (const auto tracked = tracker_->update(time_ns_, seen.views, seen.centre_in_world, {}))
                    posture = tracked->fit.posture;
            const LiveBodyFit::Seen subject{id, &seen, posture ? &*posture : nullptr};
            fit_->observe(time_ns_, {&subject, 1});
        }
    }
    void show_nobody(double seconds) {
        for (int n = 0; n < seconds * 10; ++n, time_ns_ += kFrame_ns) fit_->observe(time_ns_, {});
    }
    BodyFitProgress wait_for(BodyFitState state) {
        std::unique_lock lock(mutex_);
        EXPECT_TRUE(changed_.wait_for(lock, testing::patient(std::chrono::seconds(180)),
                                      [&] { return !told_.empty() && told_.back().state == state; }));
        return told_.back();
    }

    std::optional<PoseTracker> tracker_;  // with an average body
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
    ASSERT_TRUE(fit_->start(0, 2).ok());
    EXPECT_EQ(fit_->body_in_use(1).shape, default_body_shape());
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
    const BodyInUse in_use = fit_->body_in_use(1);
    EXPECT_EQ(in_use.shape, ready.body);
    EXPECT_EQ(fit_->body_in_use(2).shape, ready.body) << "a subject who returns has a new id";
    EXPECT_EQ(ready.stored_path, options_.file);
    const auto stored = read_body_shape(options_.file);
    ASSERT_TRUE(stored.ok()) << stored.status();
    EXPECT_NEAR(stored->stature_m, in_use.shape.stature_m, 1e-6);
}

TEST_F(LiveBodyFitTest, StartsAutomaticallyWithSubject) {
    fit_roughly();
    options_.automatic = true;
    options_.automatic_duration_s = 1;
    make();
    show_nobody(30);
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kNotStarted)
        << "waits for a subject without limit";
    show(1.2);
    const BodyFitProgress ready = wait_for(BodyFitState::kReady);
    EXPECT_FALSE(ready.requested);
    EXPECT_TRUE(ready.stored_path.empty());
    EXPECT_FALSE(std::filesystem::exists(options_.file)) << "an automatic fit is not stored";
    show(1.5);
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kReady) << "once";
    time_ns_ = 0;  // the capture restarts, possibly with another subject
    show(0.5);
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kCollecting);
}

TEST_F(LiveBodyFitTest, FitsPreliminaryBodiesToTrackedPostures) {
    options_.automatic = true;
    options_.automatic_duration_s = 3;
    tracker_.emplace(10);
    make();
    const auto stature_m = [&] { return fit_->body_in_use(1).shape.stature_m; };
    show(0.1);
    EXPECT_TRUE(
        testing::eventually([&] { return std::abs(stature_m() - 1.60) < 0.04; }, std::chrono::minutes(1)))
        << "one frame set, too little for a search";
    const BodyFitProgress first = fit_->progress().front();
    EXPECT_EQ(first.fit->frame_set_count, 1);
    show(0.8);
    const auto frame_sets = [&] { return fit_->progress().front().fit->frame_set_count; };
    EXPECT_TRUE(testing::eventually([&] { return frame_sets() > 4; }, std::chrono::minutes(1)));
    EXPECT_NEAR(stature_m(), 1.60, 0.03);
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kCollecting);
}

TEST_F(LiveBodyFitTest, SearchesSizeForPreliminaryBodyThatDoesNotFit) {
    scene_.model = std::make_shared<BodyModel>(default_body_shape(1.15));
    options_.automatic = true;
    options_.automatic_duration_s = 3;
    tracker_.emplace(10);
    make();
    show(0.1);
    EXPECT_TRUE(testing::eventually([&] { return fit_->progress().front().fit.has_value(); },
                                    std::chrono::minutes(1)));
    EXPECT_GT(fit_->body_in_use(1).std_m, 0) << "not settled";
    show(0.4);
    const auto stature_m = [&] { return fit_->body_in_use(1).shape.stature_m; };
    EXPECT_TRUE(
        testing::eventually([&] { return std::abs(stature_m() - 1.15) < 0.05; }, std::chrono::minutes(2)));
    EXPECT_EQ(fit_->body_in_use(1).std_m, 0);
}

TEST_F(LiveBodyFitTest, SearchesPosturesForPreliminaryBodyWhereNoneAreTracked) {
    options_.automatic = true;
    options_.automatic_duration_s = 3;
    make();
    show(1.2);
    const auto has_body = [&] { return fit_->progress().front().fit.has_value(); };
    ASSERT_TRUE(testing::eventually(has_body, std::chrono::minutes(3)));
    const BodyFitProgress preliminary = fit_->progress().front();
    EXPECT_EQ(preliminary.state, BodyFitState::kCollecting);
    EXPECT_NEAR(preliminary.progress, 1.1 / 3, 0.01) << "of collecting";
    EXPECT_NEAR(preliminary.body.stature_m, 1.60, 0.04);
    EXPECT_EQ(fit_->body_in_use(1).shape, preliminary.body);
    show(2);
    const BodyFitProgress ready = wait_for(BodyFitState::kReady);
    EXPECT_NE(ready.body, preliminary.body);
}

TEST_F(LiveBodyFitTest, PreliminaryBodyReplacesThatOfAnotherPerson) {
    options_.automatic = true;
    options_.automatic_duration_s = 3;
    make();
    show(3.2);
    EXPECT_NEAR(wait_for(BodyFitState::kReady).body.stature_m, 1.60, 0.03);
    scene_.model = std::make_shared<BodyModel>(default_body_shape(1.85));
    show(1.2, 2);
    const auto is_taller = [&] { return fit_->body_in_use(2).shape.stature_m > 1.78; };
    EXPECT_TRUE(testing::eventually(is_taller, std::chrono::minutes(3)));
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kCollecting);
}

TEST_F(LiveBodyFitTest, RepeatsAutomaticFitForOtherSilhouettesAndReturnsToTheFirst) {
    options_.automatic = true;
    options_.automatic_duration_s = 2;
    make();
    show(2.2);
    const BodyShape first = wait_for(BodyFitState::kReady).body;
    fit_->refit();
    EXPECT_EQ(fit_->body_in_use(1).shape, first) << "until another one is there";
    EXPECT_TRUE(fit_->awaits_refit(1));
    scene_.model = std::make_shared<BodyModel>(default_body_shape(1.62));  // may be the same person
    show(1);
    const auto is_another = [&] { return fit_->body_in_use(1).shape != first; };
    EXPECT_TRUE(testing::eventually(is_another, std::chrono::minutes(3)));
    EXPECT_FALSE(fit_->awaits_refit(1));
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kCollecting);
    fit_->undo_refit();
    EXPECT_EQ(fit_->body_in_use(1).shape, first);
    show(3);
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kReady) << "it is not fitted again";
    EXPECT_EQ(fit_->body_in_use(1).shape, first);
}

TEST_F(LiveBodyFitTest, KeepsRequestedBodyForOtherSilhouettes) {
    fit_roughly();
    options_.automatic = true;
    make();
    ASSERT_TRUE(fit_->start(0, 1).ok());
    show(1.2);
    const BodyShape requested = wait_for(BodyFitState::kReady).body;
    fit_->refit();
    EXPECT_FALSE(fit_->awaits_refit(1));
    show(2);
    EXPECT_EQ(fit_->body_in_use(1).shape, requested);
    fit_->undo_refit();
    EXPECT_EQ(fit_->body_in_use(1).shape, requested);
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kReady);
}

TEST_F(LiveBodyFitTest, FitsTheNextPersonsBodyAndRemembersTheLast) {
    options_.automatic = true;
    options_.automatic_duration_s = 1;
    make();
    show(1.2);
    const BodyShape first = wait_for(BodyFitState::kReady).body;
    EXPECT_NEAR(first.stature_m, 1.60, 0.03);
    show_nobody(1);
    scene_.model = std::make_shared<BodyModel>(default_body_shape(1.85));
    show(0.2, 2);
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kCollecting);
    EXPECT_EQ(fit_->body_in_use(2).shape, first) << "until another is fitted";
    show(1, 2);
    const BodyFitProgress second = wait_for(BodyFitState::kReady);
    EXPECT_NEAR(second.body.stature_m, 1.85, 0.04);
    show(0.1, 1);
    EXPECT_EQ(fit_->body_in_use(1).shape, first);
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kReady);
    EXPECT_THAT(fit_->progress().front().message, HasSubstr("stature 1.6"));
    show(0.1, 2);
    EXPECT_EQ(fit_->body_in_use(2).shape, second.body);
    fit_->capture_ended();
    show(0.1, 1);
    EXPECT_EQ(fit_->body_in_use(1).shape, second.body) << "the ids of another run are of others";
}

TEST_F(LiveBodyFitTest, DoesNotTakeTheNextRunsSubjectForTheOneThatWasFitted) {
    fit_roughly();
    options_.automatic = true;
    options_.automatic_duration_s = 1;
    make();
    show(1.2);
    fit_->capture_ended();
    show_nobody(0.2);
    wait_for(BodyFitState::kReady);
    show(0.2, 1);
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kCollecting);
}

TEST_F(LiveBodyFitTest, RequestPreemptsAutomaticFit) {
    fit_roughly();
    options_.automatic = true;
    options_.automatic_duration_s = 1;
    make();
    show(0.5);
    EXPECT_FALSE(fit_->progress().front().requested);
    ASSERT_TRUE(fit_->start(0, 1).ok());
    EXPECT_TRUE(fit_->progress().front().requested);
    EXPECT_EQ(fit_->progress().front().progress, 0) << "earlier observations do not count";
    show(1.2);
    wait_for(BodyFitState::kReady);
}

TEST_F(LiveBodyFitTest, FailsWithoutSubject) {
    make();
    ASSERT_TRUE(fit_->start(0, 1).ok());
    show_nobody(21);
    const BodyFitProgress failed = wait_for(BodyFitState::kFailed);
    EXPECT_THAT(failed.message, HasSubstr("no subject for"));
    EXPECT_EQ(failed.body, default_body_shape()) << "as it was";
}

TEST_F(LiveBodyFitTest, FailsWhenSilhouettesShowNoPerson) {
    make();
    ASSERT_TRUE(fit_->start(0, 1).ok());
    const PoseObservation nothing{0, {0, 0, 1}, std::vector<SilhouetteRays>(4)};
    for (int n = 0; n < 12; ++n, time_ns_ += kFrame_ns) {
        const LiveBodyFit::Seen subject{1, &nothing};
        fit_->observe(time_ns_, {&subject, 1});
    }
    EXPECT_THAT(wait_for(BodyFitState::kFailed).message, HasSubstr("no person's pose was found in"));
    EXPECT_EQ(fit_->body_in_use(1).shape, default_body_shape());
}

class SeveralBodiesTest : public LiveBodyFitTest {
  protected:
    SeveralBodiesTest() { options_.several_subjects = true; }

    void show_both(double seconds) {
        for (int n = 0; n < seconds * 10; ++n, time_ns_ += kFrame_ns) {
            const PoseObservation small{time_ns_, {0, 0, 0.9}, scene_.see(scene_.t_pose())};
            const PoseObservation tall{time_ns_, {0, 0, 0.95}, tall_.see(tall_.t_pose())};
            const std::vector<LiveBodyFit::Seen> both{{3, &small}, {7, &tall}};
            fit_->observe(time_ns_, both);
        }
    }
    void show_tall(double seconds) {
        for (int n = 0; n < seconds * 10; ++n, time_ns_ += kFrame_ns) {
            const LiveBodyFit::Seen seen{7, nullptr};
            fit_->observe(time_ns_, {&seen, 1});
        }
    }
    std::vector<std::uint32_t> reported() const {
        std::vector<std::uint32_t> ids;
        for (const BodyFitProgress& each : fit_->progress()) ids.push_back(each.subject_id);
        return ids;
    }

    testing::SeenBody tall_{.model = std::make_shared<BodyModel>(default_body_shape(1.88))};
};

TEST_F(SeveralBodiesTest, FitsEachSubjectsBody) {
    options_.automatic = true;
    options_.automatic_duration_s = 1;
    make();
    EXPECT_THAT(reported(), ElementsAre(0)) << "the body of the next subject";
    show_both(1.2);
    EXPECT_THAT(reported(), ElementsAre(3, 7));
    const auto all_are_ready = [&] {
        return std::ranges::all_of(
            fit_->progress(), [](const BodyFitProgress& each) { return each.state == BodyFitState::kReady; });
    };
    ASSERT_TRUE(testing::eventually(all_are_ready, std::chrono::minutes(4)));  // two fits at low priority
    EXPECT_NEAR(fit_->body_in_use(3).shape.stature_m, 1.60, 0.04);
    EXPECT_NEAR(fit_->body_in_use(7).shape.stature_m, 1.88, 0.04);
    EXPECT_EQ(fit_->body_in_use(8).shape, default_body_shape());
    show_tall(0.5);
    EXPECT_THAT(reported(), ElementsAre(7));
    show_both(0.2);
    EXPECT_THAT(reported(), ElementsAre(3, 7));
    EXPECT_NEAR(fit_->body_in_use(3).shape.stature_m, 1.60, 0.04) << "who returned";
    fit_->capture_ended();
    EXPECT_THAT(reported(), ElementsAre(3, 7)) << "until the next run begins";
    show_tall(0.1);
    EXPECT_THAT(reported(), ElementsAre(7));
    EXPECT_EQ(fit_->body_in_use(7).shape, default_body_shape()) << "the same id, another person";
}

TEST_F(SeveralBodiesTest, RequestWaitsForTheNextSubject) {
    make();
    ASSERT_TRUE(fit_->start(0, 1).ok());
    show_nobody(2);
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kCollecting);
    show_both(0.2);
    const std::vector<BodyFitProgress> progress = fit_->progress();
    ASSERT_EQ(progress.size(), 2u);
    EXPECT_EQ(progress[0].state, BodyFitState::kCollecting);
    EXPECT_TRUE(progress[0].requested);
    EXPECT_EQ(progress[1].state, BodyFitState::kNotStarted);
}

TEST_F(SeveralBodiesTest, RequestFailsWhenItsSubjectLeaves) {
    make();
    show_both(0.2);
    ASSERT_TRUE(fit_->start(3, 5).ok());
    show_both(0.5);
    show_tall(15);
    EXPECT_THAT(reported(), ElementsAre(3, 7)) << "a client waits for it";
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kCollecting);
    show_tall(10);
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kFailed);
    EXPECT_THAT(fit_->progress().front().message, HasSubstr("subject 3 has left"));
    show_tall(60);
    EXPECT_THAT(reported(), ElementsAre(7));
}

TEST_F(LiveBodyFitTest, RejectsInvalidOptions) {
    make();
    for (const double seconds : {0.5, 31.0, -1.0, std::nan("")})
        EXPECT_EQ(fit_->start(0, seconds).code(), absl::StatusCode::kInvalidArgument) << seconds;
    fit_->close();
    EXPECT_EQ(fit_->start(0, 2).code(), absl::StatusCode::kUnavailable);
}

TEST_F(LiveBodyFitTest, ClosesImmediately) {
    options_.fit.rounds = 1000;  // as good as for ever
    make();
    ASSERT_TRUE(fit_->start(0, 1).ok());
    show(1.2);
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kFitting);
    const auto start = steady_clock::now();
    fit_.reset();
    // Its longest step is the search for a body that it knows nothing of.
    EXPECT_LT(steady_clock::now() - start, testing::patient(std::chrono::milliseconds(1500)));
}

}  // namespace
}  // namespace kinevox
