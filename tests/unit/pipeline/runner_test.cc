#include "server/pipeline/runner.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <future>
#include <thread>

#include "tests/support/fake_capture.h"
#include "tests/support/patience.h"
#include "tests/support/person_volume.h"

namespace {
std::atomic<std::int64_t> added_clock_s{0};
}  // namespace

// The system clock of this program, which a test may step; the steady clock stays.
extern "C" int clock_gettime(clockid_t clock, timespec* time) noexcept {
    const int status = static_cast<int>(syscall(SYS_clock_gettime, clock, time));
    if (status == 0 && clock == CLOCK_REALTIME) time->tv_sec += added_clock_s;
    return status;
}

namespace kinevox {
namespace {

using ::testing::HasSubstr;

class RunnerTest : public ::testing::Test {
  protected:
    RunnerTest() {
        auto pipeline = std::make_unique<testing::FakePipeline>(
            std::make_shared<const Volume>(testing::person_volume(0.05)));
        pipeline_ = pipeline.get();
        box_ = hub_.subscribe_volumes({MailboxOptions::WhenFull::kOverflow, 1000, SIZE_MAX},
                                      [this] { changed(); });
        events_ = hub_.events().subscribe(0, [this] { changed(); });
        runner_.emplace(
            source_.open(), [this] { return source_.open(); }, std::move(pipeline), hub_);
    }

    void changed() {
        const std::scoped_lock lock(mutex_);
        changed_.notify_all();
    }

    // Waits for the next N results; their sequences.
    std::vector<std::uint64_t> results(std::size_t count) {
        std::vector<std::uint64_t> out;
        std::unique_lock lock(mutex_);
        const bool arrived = changed_.wait_for(lock, kMaxWait, [&] {
            while (out.size() < count)
                if (const auto taken = box_->take())
                    out.push_back(taken->message->header.sequence), last_ = taken->message;
                else
                    return false;
            return true;
        });
        EXPECT_TRUE(arrived) << out.size() << " of " << count << " results";
        return out;
    }

    // Waits for an event of this kind; its message.
    std::string event(EventKind kind) {
        std::string message;
        std::unique_lock lock(mutex_);
        const bool arrived = changed_.wait_for(lock, kMaxWait, [&] {
            while (const auto taken = events_->take())
                if (taken->message.event.kind == kind) {
                    message = taken->message.event.message;
                    return true;
                }
            return false;
        });
        EXPECT_TRUE(arrived) << "no event " << event_name(kind);
        return message;
    }

    static constexpr auto kMaxWait = testing::patient(std::chrono::seconds(20));

    std::mutex mutex_;
    std::condition_variable changed_;
    testing::FakeSourceControl source_;
    StreamHub hub_;
    std::shared_ptr<VolumeMailbox> box_;
    std::shared_ptr<EventMailbox> events_;
    std::shared_ptr<const PublishedVolume> last_;
    testing::FakePipeline* pipeline_ = nullptr;
    std::optional<Runner> runner_;  // last: its threads use the others
};

TEST_F(RunnerTest, SteppedClockIsAnEventOfItsOwn) {
    source_.live = true;
    ASSERT_TRUE(runner_->start().ok());
    source_.give(1);
    results(1);
    const std::int64_t before_ns = last_->header.capture_time_utc_ns;
    added_clock_s = 3600;
    source_.give(1);
    EXPECT_THAT(event(EventKind::kClockStepped), HasSubstr("forward by 3600.0 s"));
    results(1);
    added_clock_s = 0;
    EXPECT_NEAR(1e-9 * static_cast<double>(last_->header.capture_time_utc_ns - before_ns), 3600, 60);
    EXPECT_TRUE(runner_->stop().ok());
}

TEST_F(RunnerTest, StartsLearnsAndPublishesInOrder) {
    ASSERT_TRUE(runner_->start().ok());
    EXPECT_THAT(event(EventKind::kBackgroundLearned), HasSubstr("2 images"));
    source_.give(3);
    EXPECT_THAT(results(3), ::testing::ElementsAre(0, 1, 2));
    EXPECT_EQ(runner_->state().state, RunState::kRunning);
    EXPECT_EQ(runner_->start().code(), absl::StatusCode::kFailedPrecondition);
    ASSERT_TRUE(runner_->stop().ok());
    EXPECT_EQ(pipeline_->learned_images, 2u);
    EXPECT_EQ(runner_->state().state, RunState::kStopped);
    EXPECT_EQ(runner_->stop().code(), absl::StatusCode::kFailedPrecondition);
}

// The first frame set is held where its pose is found, until release().
class HeldPose {
  public:
    explicit HeldPose(testing::FakePipeline& pipeline) {
        pipeline.on_pose = [this](std::uint64_t sequence) {
            if (sequence > 0) return;
            held_.set_value();
            release_.get_future().wait();
        };
        pipeline.on_reconstruct = [this](std::uint64_t sequence) { newest_begun = sequence; };
    }
    void wait_until_held() { held_.get_future().wait(); }
    void release() { release_.set_value(); }
    std::atomic<std::uint64_t> newest_begun = 0;

  private:
    std::promise<void> held_, release_;
};

template <class Condition>
bool comes(Condition condition, std::chrono::milliseconds limit) {
    for (const auto end = std::chrono::steady_clock::now() + limit; std::chrono::steady_clock::now() < end;
         std::this_thread::sleep_for(std::chrono::milliseconds(1)))
        if (condition()) return true;
    return false;
}

using namespace std::chrono_literals;

TEST_F(RunnerTest, TakesLatestFrameSetOfCameras) {
    source_.live = source_.cameras = true;
    HeldPose pose(*pipeline_);
    ASSERT_TRUE(runner_->start().ok());
    source_.give(1);
    pose.wait_until_held();
    source_.give(1);
    ASSERT_TRUE(comes([&] { return pose.newest_begun == 1; }, 10s)) << "one ahead";
    source_.give(8);
    ASSERT_TRUE(comes([&] { return source_.waiting() == 0; }, 10s)) << "cameras are not held up";
    EXPECT_EQ(pose.newest_begun, 1u);
    pose.release();
    EXPECT_THAT(results(3), ::testing::ElementsAre(0, 1, 9));
    EXPECT_EQ(runner_->snapshot().lost_count, 7u);
}

TEST_F(RunnerTest, RendersNoStudioImagesAhead) {
    source_.live = true;
    HeldPose pose(*pipeline_);
    ASSERT_TRUE(runner_->start().ok());
    source_.give(10);
    pose.wait_until_held();
    ASSERT_TRUE(comes([&] { return pose.newest_begun == 1 && source_.waiting() == 7; }, 10s));
    EXPECT_FALSE(comes([&] { return pose.newest_begun > 1 || source_.waiting() < 7; }, 100ms));
    pose.release();
    EXPECT_THAT(results(10), ::testing::ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9));
}

TEST_F(RunnerTest, FetchesRecordingAhead) {
    HeldPose pose(*pipeline_);
    ASSERT_TRUE(runner_->start().ok());
    source_.give(10);
    pose.wait_until_held();
    EXPECT_TRUE(comes([&] { return pose.newest_begun == 2 && source_.waiting() == 5; }, 10s));
    pose.release();
    EXPECT_THAT(results(10), ::testing::ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9));
}

TEST_F(RunnerTest, AppliesOtherCamerasBetweenRuns) {
    std::vector<std::vector<Camera>> taken;
    runner_->set_on_cameras([&](const std::vector<Camera>& cameras) { taken.push_back(cameras); });
    const std::vector<Camera> own = testing::fake_cameras();
    std::vector<Camera> better = own, best = own;
    better[0].fx += 1;
    best[0].fx += 2;
    EXPECT_TRUE(runner_->set_cameras(own));  // as they are: nothing to take
    EXPECT_TRUE(taken.empty());
    EXPECT_TRUE(runner_->set_cameras(better));
    EXPECT_EQ(runner_->cameras(), better);
    EXPECT_EQ(pipeline_->cameras_set, better);
    ASSERT_TRUE(runner_->start().ok());  // the source is still known by its own cameras
    EXPECT_FALSE(runner_->set_cameras(best));
    EXPECT_FALSE(runner_->set_cameras(own));
    EXPECT_EQ(runner_->cameras(), better);
    source_.give(1);
    results(1);
    ASSERT_TRUE(runner_->stop().ok());
    EXPECT_EQ(runner_->cameras(), better);
    ASSERT_TRUE(runner_->start().ok());
    EXPECT_EQ(runner_->cameras(), own);
    EXPECT_THAT(taken, ::testing::ElementsAre(better, own));
}

TEST_F(RunnerTest, ConvertsCaptureTimesToUtc) {
    ASSERT_TRUE(runner_->start().ok());
    const auto now = std::chrono::duration_cast<std::chrono::nanoseconds>(
                         std::chrono::system_clock::now().time_since_epoch())
                         .count();
    source_.give(2);
    results(1);
    const std::int64_t first = last_->header.capture_time_utc_ns;
    results(1);
    EXPECT_NEAR(static_cast<double>(first - now), 0, 60e9);
    EXPECT_EQ(last_->header.capture_time_utc_ns - first, 10'000'000);
}

TEST_F(RunnerTest, CountsFrameSetsLostBeforeThePipeline) {
    ASSERT_TRUE(runner_->start().ok());
    source_.give(1);
    results(1);
    source_.lose(3);
    source_.give(1);
    EXPECT_THAT(results(1), ::testing::ElementsAre(4));
    EXPECT_EQ(runner_->snapshot().lost_count, 3u);
    EXPECT_EQ(runner_->snapshot().result_count, 2u);
}

TEST_F(RunnerTest, RestartsEndedRecording) {
    source_.give(2);
    source_.end();
    ASSERT_TRUE(runner_->start().ok());
    event(EventKind::kSourceEnded);
    EXPECT_EQ(runner_->state().state, RunState::kEnded);
    EXPECT_THAT(results(2), ::testing::ElementsAre(0, 1));
    source_.give(1);
    ASSERT_TRUE(runner_->start().ok());
    EXPECT_THAT(results(1), ::testing::ElementsAre(0));
    EXPECT_EQ(source_.opened(), 2);
}

TEST_F(RunnerTest, ReportsErrorOfSource) {
    source_.fail(absl::DataLossError("camera left: clip.mp4 breaks off at frame 7"));
    ASSERT_TRUE(runner_->start().ok());
    EXPECT_THAT(event(EventKind::kError), HasSubstr("breaks off"));
    EXPECT_EQ(runner_->state().state, RunState::kFailed);
    EXPECT_THAT(runner_->state().message, HasSubstr("breaks off"));
}

TEST_F(RunnerTest, EndsOnErrorOfPipeline) {
    pipeline_->reconstruct_error = absl::InvalidArgumentError("camera left: image of 10x10");
    ASSERT_TRUE(runner_->start().ok());
    source_.give(5);
    EXPECT_THAT(event(EventKind::kError), HasSubstr("10x10"));
    EXPECT_EQ(runner_->state().state, RunState::kFailed);
}

TEST_F(RunnerTest, EndsOnErrorOfPoseStage) {
    pipeline_->pose_error = absl::InternalError("frame set 0: out of memory");
    ASSERT_TRUE(runner_->start().ok());
    source_.give(5);
    EXPECT_THAT(event(EventKind::kError), HasSubstr("out of memory"));
    EXPECT_EQ(runner_->state().state, RunState::kFailed);
    ASSERT_TRUE(runner_->start().ok()) << "the other threads have ended";
}

TEST_F(RunnerTest, ReconstructsNextFrameSetDuringPose) {
    std::promise<void> second_begun;
    std::future_status seen = std::future_status::timeout;
    pipeline_->on_reconstruct = [&](std::uint64_t sequence) {
        if (sequence == 1) second_begun.set_value();
    };
    pipeline_->on_pose = [&, begun = second_begun.get_future().share()](std::uint64_t sequence) {
        if (sequence == 0) seen = begun.wait_for(std::chrono::seconds(30));
    };
    ASSERT_TRUE(runner_->start().ok());
    source_.give(3);
    EXPECT_THAT(results(3), ::testing::ElementsAre(0, 1, 2));
    EXPECT_EQ(seen, std::future_status::ready);
}

TEST_F(RunnerTest, LearnsBackgroundFromLiveFrameSets) {
    ASSERT_TRUE(runner_->start().ok());
    source_.give(1);
    results(1);
    std::promise<absl::Status> learned;
    runner_->learn_background(5, [&](absl::Status status) { learned.set_value(std::move(status)); });
    EXPECT_EQ(runner_->state().state, RunState::kLearning);
    source_.give(6);
    EXPECT_TRUE(learned.get_future().get().ok());
    EXPECT_THAT(results(1), ::testing::ElementsAre(6));
    ASSERT_TRUE(runner_->stop().ok());
    EXPECT_EQ(pipeline_->learned_images, 5u);
}

TEST_F(RunnerTest, RestoresThePreviousBackground) {
    EXPECT_EQ(runner_->restore_background().code(), absl::StatusCode::kFailedPrecondition) << "none";
    ASSERT_TRUE(runner_->start().ok());
    source_.give(1);
    results(1);
    const std::size_t first = pipeline_->learned_images;
    std::promise<absl::Status> learned;
    runner_->learn_background(5, [&](absl::Status status) { learned.set_value(std::move(status)); });
    source_.give(6);
    ASSERT_TRUE(learned.get_future().get().ok());
    EXPECT_EQ(runner_->restore_background().code(), absl::StatusCode::kFailedPrecondition) << "it runs";
    ASSERT_TRUE(runner_->stop().ok());
    ASSERT_NE(pipeline_->learned_images, first);
    ASSERT_TRUE(runner_->restore_background().ok());
    EXPECT_EQ(pipeline_->learned_images, std::min(first, Runner::kKeptBackgroundImages));
    ASSERT_TRUE(runner_->restore_background().ok());  // and back
    EXPECT_EQ(pipeline_->learned_images, 5u);
}

TEST_F(RunnerTest, PublishesImagesOnlyWithoutBackground) {
    source_.with_background = false;
    ASSERT_TRUE(runner_->start().ok());
    source_.give(1);
    results(1);
    EXPECT_THAT(last_->subjects, ::testing::IsEmpty());
    std::promise<absl::Status> learned;
    runner_->learn_background(2, [&](absl::Status status) { learned.set_value(std::move(status)); });
    source_.give(3);
    EXPECT_TRUE(learned.get_future().get().ok());
    results(1);
    ASSERT_EQ(last_->subjects.size(), 1u);
    EXPECT_NE(last_->subjects[0].volume, nullptr);
}

TEST_F(RunnerTest, RejectsInvalidLearningRequests) {
    const auto learned = [&](int frames) {
        absl::Status out;
        runner_->learn_background(frames, [&](absl::Status status) { out = std::move(status); });
        return out;
    };
    EXPECT_EQ(learned(-1).code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(learned(1001).code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(learned(5).code(), absl::StatusCode::kFailedPrecondition) << "nothing runs";
    EXPECT_TRUE(learned(0).ok()) << "the source's background images";
    ASSERT_TRUE(runner_->start().ok());
    EXPECT_EQ(learned(0).code(), absl::StatusCode::kFailedPrecondition) << "it runs";
    ASSERT_TRUE(runner_->stop().ok());
    source_.with_background = false;
    EXPECT_THAT(std::string(learned(0).message()), HasSubstr("no background images"));
}

TEST_F(RunnerTest, EndsLearningOnStop) {
    ASSERT_TRUE(runner_->start().ok());
    std::promise<absl::Status> learned;
    runner_->learn_background(5, [&](absl::Status status) { learned.set_value(std::move(status)); });
    ASSERT_TRUE(runner_->stop().ok());
    EXPECT_EQ(learned.get_future().get().code(), absl::StatusCode::kAborted);
}

TEST_F(RunnerTest, EndsIdleLearning) {
    runner_->set_idle_timeout(std::chrono::seconds(1));
    ASSERT_TRUE(runner_->start().ok());
    const auto learns = [&](int given) {
        std::promise<absl::Status> learned;
        runner_->learn_background(5, [&](absl::Status status) { learned.set_value(std::move(status)); });
        for (int i = 0; i < given; ++i) {
            std::this_thread::sleep_for(std::chrono::milliseconds(300));  // slow, but they come
            source_.give(1);
        }
        return learned.get_future().get();
    };
    const absl::Status silent = learns(2);
    EXPECT_EQ(silent.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(silent.message()), HasSubstr("no frame set for 1 s, after 2 of 5"));
    EXPECT_EQ(runner_->state().state, RunState::kRunning);
    EXPECT_TRUE(learns(5).ok()) << "again, from the first";
    source_.give(1);
    EXPECT_THAT(results(1), ::testing::ElementsAre(7));
}

TEST_F(RunnerTest, StartsNothingAfterAbort) {
    ASSERT_TRUE(runner_->start().ok());
    runner_->abort();
    EXPECT_TRUE(runner_->stop().ok());
    EXPECT_EQ(runner_->start().code(), absl::StatusCode::kUnavailable);
}

TEST(RunStatistics, ComputesRateMediansAndLosses) {
    RunStatistics statistics;
    const auto start = RunStatistics::Clock::now();
    for (int i = 0; i < 100; ++i) {
        StageTimes times;
        times.hull_ms = i % 10;
        times.total_ms = i == 99 ? 1000 : 10;
        statistics.add(static_cast<std::uint64_t>(i), times, start + i * std::chrono::milliseconds(20));
    }
    const auto snapshot = statistics.snapshot(start + 99 * std::chrono::milliseconds(20));
    EXPECT_NEAR(snapshot.result_rate_hz, 50, 1e-6);
    EXPECT_EQ(snapshot.median.total_ms, 10);
    EXPECT_NEAR(snapshot.median.hull_ms, 4.5, 0.6);
    EXPECT_EQ(statistics.snapshot(start + std::chrono::seconds(10)).result_rate_hz, 0);
}

}  // namespace
}  // namespace kinevox
