// A recording in the cameras' place, in a real daemon.
#include <gmock/gmock.h>
#include <signal.h>

#include <condition_variable>
#include <deque>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "common/calibration_file.h"
#include "tests/integration/daemon/calibration_operator.h"
#include "tests/integration/daemon/daemon_fixture.h"
#include "tests/support/patience.h"

namespace kinevox {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::Operator;

constexpr int kFrames = 30;

// What a frame set of the recording led to.
struct Shown {
    std::uint64_t sequence = 0;
    std::optional<std::int64_t> frame;
    std::optional<Volume> volume;
    std::string pose;  // serialised, without the subject's number; empty: none
};

// Follows volumes and poses from its construction on.
class Follower {
  public:
    explicit Follower(const std::string& address) : address_(address) {
        volumes_ = std::jthread([this](const std::stop_token& stop) {
            v1::StreamVolumesRequest every;
            every.set_delivery(v1::DELIVERY_LOSSLESS);
            client::StreamOptions options;
            options.stop = stop;
            client::Client({.server = address_})
                .stream_volumes(
                    every,
                    [this](const client::VolumeFrame& frame) {
                        take(
                            frame.header, [&](Shown& shown) { shown.volume = frame.volume; }, 1);
                        return true;
                    },
                    options)
                .IgnoreError();
        });
        poses_ = std::jthread([this](const std::stop_token& stop) {
            v1::StreamPosesRequest every;
            every.set_delivery(v1::DELIVERY_LOSSLESS);
            client::StreamOptions options;
            options.stop = stop;
            client::Client({.server = address_})
                .stream_poses(
                    every,
                    [this](const v1::StreamPosesResponse& message) {
                        v1::Pose pose = message.pose();
                        pose.set_subject_id(0);
                        take(
                            message.header(),
                            [&](Shown& shown) {
                                shown.pose = message.has_pose() ? pose.SerializeAsString() : "";
                            },
                            2);
                        return true;
                    },
                    options)
                .IgnoreError();
        });
        client::Client client({.server = address_});
        for (auto status = client.status(); status.ok(); status = client.status())
            if (status->volume_subscribers() > 0 && status->pose_subscribers() > 0) break;
    }

    // The first that was not asked for before and is `so`, with both its volume and its pose.
    Shown wait(const std::function<bool(const Shown&)>& so) {
        std::unique_lock lock(mutex_);
        Shown found;
        const bool in_time = changed_.wait_for(lock, std::chrono::seconds(20), [&] {
            while (!waiting_.empty() && waiting_.front().second == 3) {
                const Shown shown = std::move(waiting_.front().first);
                waiting_.pop_front();
                if (!so(shown)) continue;
                found = shown;
                return true;
            }
            return false;
        });
        EXPECT_TRUE(in_time) << "nothing came";
        return found;
    }
    Shown frame(std::int64_t number) {
        return wait([&](const Shown& shown) { return shown.frame == number; });
    }

  private:
    void take(const v1::StreamHeader& header, const std::function<void(Shown&)>& fill, int part) {
        const std::scoped_lock lock(mutex_);
        auto at = std::find_if(waiting_.begin(), waiting_.end(), [&](const auto& one) {
            return one.first.sequence == header.sequence() && (one.second & part) == 0;
        });
        if (at == waiting_.end()) {
            waiting_.emplace_back();
            at = std::prev(waiting_.end());
        }
        at->first.sequence = header.sequence();
        if (header.has_recorded_frame()) at->first.frame = header.recorded_frame();
        fill(at->first);
        at->second |= part;
        changed_.notify_all();
    }

    std::string address_;
    std::mutex mutex_;
    std::condition_variable changed_;
    std::deque<std::pair<Shown, int>> waiting_;  // and which parts of it came
    std::jthread volumes_, poses_;
};

void expect_same(const Shown& a, const Shown& b) {
    EXPECT_TRUE(a.volume && b.volume);
    EXPECT_TRUE(a.volume == b.volume) << "the volumes differ";
    EXPECT_FALSE(a.pose.empty());
    EXPECT_TRUE(a.pose == b.pose) << "the poses differ";
}

class ReplayTest : public testing::DaemonTest {
  protected:
    static void SetUpTestSuite() {
        DaemonTest::SetUpTestSuite();
        recording_ = testing::write_small_session(shared_->path() / "recording",
                                                  {.frames = kFrames, .width = 144, .height = 108});
    }

    std::string config() const {
        return session_config("127.0.0.1:0", "", "fit_body = false\ndatabase = \"\"") +
               "[calibration]\nfolder = \"calibrations\"\n[pipeline]\nvoxel_mm = 30\ncolouring = false\n";
    }
    static v1::OpenReplayRequest recording(const std::string& lease, bool paused) {
        v1::OpenReplayRequest request;
        request.set_lease_id(lease);
        request.set_session(recording_.string());
        request.set_paused(paused);
        return request;
    }
    static v1::SetReplayRequest seek(const std::string& lease, std::int64_t frame) {
        v1::SetReplayRequest request;
        request.set_lease_id(lease);
        request.set_frame(frame);
        return request;
    }

    static inline std::filesystem::path recording_;
};

TEST_F(ReplayTest, EveryStreamShowsTheRecordingAndThenTheCamerasAgain) {
    const auto daemon = start_daemon(config());
    Operator coach(address_);
    client::Client& client = coach.client();
    Follower follower(address_);
    follower.wait([](const Shown& shown) { return !shown.frame && shown.volume; });
    const std::vector<Camera> live = *client.cameras();

    const auto opened = client.open_replay("", recording(coach.lease(), true));
    ASSERT_TRUE(opened.ok()) << opened.status();
    EXPECT_EQ(opened->replay().frames(), kFrames);
    EXPECT_EQ(opened->replay().fps(), 20);
    const Shown first = follower.frame(0);
    EXPECT_EQ(*client.cameras(), *read_calibration(recording_.parent_path() / "calibration.toml"));
    const auto status = client.status();
    ASSERT_TRUE(status.ok());
    EXPECT_THAT(status->source(), HasSubstr("replay of"));
    EXPECT_EQ(status->state(), v1::CAPTURE_STATE_RUNNING);

    // Wherever it is sought from, a frame set shows the same; the numbers go on.
    ASSERT_TRUE(client.set_replay("", seek(coach.lease(), 17)).ok());
    const Shown sought = follower.frame(17);
    ASSERT_TRUE(client.set_replay("", seek(coach.lease(), 4)).ok());
    follower.frame(4);
    v1::SetReplayRequest step;
    step.set_lease_id(coach.lease());
    step.set_step(1);
    ASSERT_TRUE(client.set_replay("", step).ok());
    follower.frame(5);
    ASSERT_TRUE(client.set_replay("", seek(coach.lease(), 17)).ok());
    const Shown again = follower.frame(17);
    expect_same(sought, again);
    EXPECT_GT(again.sequence, sought.sequence);
    step.set_step(-17);
    ASSERT_TRUE(client.set_replay("", step).ok());
    expect_same(first, follower.frame(0));
    EXPECT_EQ(client.get_replay()->replay().state(), v1::REPLAY_STATE_PAUSED);
    EXPECT_EQ(client.get_replay()->replay().jumps(), 4u);

    // It plays to its end and waits there.
    v1::SetReplayRequest play;
    play.set_lease_id(coach.lease());
    play.set_play(true);
    ASSERT_TRUE(client.set_replay("", play).ok());
    follower.frame(kFrames - 1);
    EXPECT_EQ(client.get_replay()->replay().state(), v1::REPLAY_STATE_ENDED);
    EXPECT_EQ(client.status()->state(), v1::CAPTURE_STATE_RUNNING);

    // The cameras' background was not forgotten.
    ASSERT_TRUE(coach.client().release_control(coach.lease()).ok());
    ASSERT_TRUE(client.close_replay("coach").ok());
    follower.wait([](const Shown& shown) { return !shown.frame && shown.volume; });
    EXPECT_EQ(*client.cameras(), live);
    EXPECT_EQ(client.get_replay()->replay().state(), v1::REPLAY_STATE_LIVE);
    EXPECT_EQ(coach.events(v1::EVENT_KIND_REPLAY, 2, std::chrono::seconds(10)).size(), 2u);
    EXPECT_EQ(coach.events(v1::EVENT_KIND_BACKGROUND_LEARNED, 2, std::chrono::seconds(10)).size(), 2u)
        << "the cameras' and the recording's, once each";
    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(std::chrono::seconds(10)), 0);
}

TEST_F(ReplayTest, RefusesWhatCannotBeAndSaysWhy) {
    const auto daemon = start_daemon(config());
    Operator coach(address_);
    client::Client& client = coach.client();
    testing::wait_until_running(client);
    EXPECT_REFUSED(client.open_replay("somebody", recording("", true)), kFailedPrecondition, "coach");
    v1::OpenReplayRequest open = recording(coach.lease(), true);
    open.set_session("session.toml");
    EXPECT_REFUSED(client.open_replay("", open), kNotFound, "no absolute path");
    open.set_session("/nowhere/session.toml");
    EXPECT_REFUSED(client.open_replay("", open), kNotFound, "/nowhere/session.toml");
    open = recording(coach.lease(), true);
    open.set_speed(-1);
    EXPECT_REFUSED(client.open_replay("", open), kInvalidArgument, "speed");
    EXPECT_REFUSED(client.set_replay("", seek(coach.lease(), 0)), kFailedPrecondition, "nothing is replayed");
    EXPECT_REFUSED(client.close_replay("somebody"), kFailedPrecondition, "coach");
    EXPECT_EQ(client.status()->state(), v1::CAPTURE_STATE_RUNNING) << "the cameras are seen as before";

    // Calibrating and replaying shut each other out.
    ASSERT_TRUE(coach.start(v1::PROCEDURE_KIND_INTRINSICS).ok());
    EXPECT_REFUSED(client.open_replay("", recording(coach.lease(), true)), kFailedPrecondition,
                   "calibration procedure");
    ASSERT_TRUE(coach.cancel().ok());
    ASSERT_TRUE(client.open_replay("", recording(coach.lease(), true)).ok());
    EXPECT_REFUSED(coach.start(v1::PROCEDURE_KIND_INTRINSICS), kFailedPrecondition, "replay live");
    EXPECT_REFUSED(coach.undo(false), kFailedPrecondition, "replay live");
    EXPECT_REFUSED(client.set_replay("", seek(coach.lease(), kFrames)), kOutOfRange, "0 to 29");
    v1::SetReplayRequest speed;
    speed.set_lease_id(coach.lease());
    speed.set_speed(1e6);
    EXPECT_REFUSED(client.set_replay("", speed), kOutOfRange, "speed");
}

TEST_F(ReplayTest, WhatWasRecordedIsOpenedByItsNameAndNotRecordedAgain) {
    const std::string recording_config =
        fmt::format("[recording]\nfolder = \"{}\"\nkeep_last_s = 1\nleast_free_mb = 0\n",
                    (folder_.path() / "kept").string());
    auto daemon = start_daemon(config() + recording_config);
    {
        client::Client client({.server = address_});
        testing::wait_until_running(client);
        v1::OpenReplayRequest open;
        open.set_paused(true);
        open.set_session("walk");
        EXPECT_REFUSED(client.open_replay("coach", open), kNotFound, "which has none");
        v1::StartRecordingRequest start;
        start.set_name("walk");
        v1::KeepLastRequest keep;
        const auto started = client.start_recording("coach", start);
        ASSERT_TRUE(started.ok()) << started.status();
        EXPECT_REFUSED(client.open_replay("coach", open), kFailedPrecondition, "\"walk\" is being recorded");
        EXPECT_REFUSED(client.open_replay("coach", recording("", true)), kFailedPrecondition,
                       "kinevox record stop");
        const auto recorded = [&] {
            for (int i = 0; i < testing::patient(400);
                 ++i, std::this_thread::sleep_for(std::chrono::milliseconds(25)))
                if (const auto now = client.recorder_status(); now.ok() && now->recording().frames() >= 10)
                    return true;
            return false;
        };
        ASSERT_TRUE(recorded());
        ASSERT_TRUE(client.stop_recording("coach", std::chrono::seconds(20)).ok());

        const auto shown = kinevox({"replay", "open", "walk", "--paused"});
        EXPECT_EQ(shown.status, 0) << shown.errors;
        EXPECT_THAT(shown.output, HasSubstr("kept/walk/session.toml"));
        start.set_name("again");
        EXPECT_REFUSED(client.start_recording("coach", start), kFailedPrecondition, "kinevox replay live");
        EXPECT_REFUSED(client.keep_last("coach", keep, std::chrono::seconds(20)), kFailedPrecondition,
                       "kinevox replay live");
        const auto none = kinevox({"replay", "open", "run"});
        EXPECT_EQ(none.status, 1);
        EXPECT_THAT(none.errors, AllOf(HasSubstr("'run' is no absolute path"), HasSubstr("which has walk")));
        EXPECT_THAT(kinevox({"replay", "open", "./run"}).errors, HasSubstr("/run: no such file"));
        ASSERT_TRUE(client.close_replay("coach").ok());
        start.set_name("killed");
        ASSERT_TRUE(client.start_recording("coach", start).ok()) << "the cameras are seen again";
        ASSERT_TRUE(recorded());
    }
    daemon->signal(SIGKILL);
    daemon->wait(std::chrono::seconds(10));

    daemon = start_daemon(config() + recording_config);
    client::Client client({.server = address_});
    Follower follower(address_);
    v1::OpenReplayRequest open;
    open.set_session("killed");
    open.set_paused(true);
    const auto opened = client.open_replay("coach", open);
    ASSERT_TRUE(opened.ok()) << opened.status();
    EXPECT_GE(opened->replay().frames(), 9);
    EXPECT_TRUE(follower.frame(0).volume);
    const auto list = client.list_recordings();
    ASSERT_TRUE(list.ok()) << list.status();
    ASSERT_EQ(list->recordings_size(), 2);
    EXPECT_TRUE(list->recordings(1).closed() && list->recordings(1).recovered());
}

TEST_F(ReplayTest, TheCommandLine) {
    const auto daemon = start_daemon(config());
    const auto replay = [&](std::vector<std::string> words) {
        words.insert(words.begin(), "replay");
        return kinevox(words);
    };
    EXPECT_EQ(replay({"status"}).output, "live\n");
    const auto opened = replay({"open", recording_.string(), "--paused", "--loop"});
    EXPECT_EQ(opened.status, 0) << opened.errors;
    EXPECT_THAT(opened.output, HasSubstr("of 30"));
    const auto now = [&] { return json::parse(replay({"status", "--json"}).output); };
    const auto shows = [&](int frame) {
        for (int i = 0; i < 200; ++i)
            if (now().value("frame", -2) == frame) return true;
        return false;
    };
    EXPECT_EQ(replay({"seek", "12"}).status, 0);
    EXPECT_TRUE(shows(12)) << now();
    EXPECT_EQ(replay({"seek", "1s"}).status, 0);
    EXPECT_TRUE(shows(20)) << now();
    EXPECT_EQ(replay({"step"}).status, 0);
    EXPECT_TRUE(shows(21)) << now();
    EXPECT_EQ(replay({"step", "-2"}).status, 0) << replay({"step", "-2"}).errors;
    EXPECT_TRUE(shows(19)) << now();
    EXPECT_EQ(replay({"speed", "0.5"}).status, 0);
    EXPECT_EQ(replay({"loop", "off"}).status, 0);
    EXPECT_EQ(now()["speed"], 0.5);
    EXPECT_FALSE(now().value("loop", false));
    EXPECT_THAT(replay({"play"}).output, HasSubstr("playing"));
    EXPECT_THAT(replay({"pause"}).output, HasSubstr("paused"));
    for (const auto& [words, why] : std::vector<std::pair<std::vector<std::string>, std::string>>{
             {{"seek", "later"}, "neither a frame"},
             {{"seek", "99"}, "0 to 29"},
             {{"open", "/nowhere.toml"}, "nowhere"}}) {
        const auto refused = replay(words);
        EXPECT_EQ(refused.status, 1);
        EXPECT_THAT(refused.errors, HasSubstr(why));
    }
    EXPECT_EQ(replay({"live"}).output, "live\n");
    EXPECT_THAT(replay({"live"}).errors, HasSubstr("nothing is replayed"));
}

}  // namespace
}  // namespace kinevox
