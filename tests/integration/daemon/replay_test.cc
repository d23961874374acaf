// Replay of recordings in a running daemon.
#include <gmock/gmock.h>
#include <signal.h>

#include <condition_variable>
#include <deque>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "common/calibration_file.h"
#include "common/recording_files.h"
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

// The results of one frame set of the recording.
struct Shown {
    std::uint64_t sequence = 0;
    std::optional<std::int64_t> frame;
    std::optional<Volume> volume;
    std::string pose;  // serialised; empty: none
};

// Subscribes to volumes and poses.
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
                            frame.header,
                            [&](Shown& shown) {
                                if (const auto* subject = frame.first_subject())
                                    shown.volume = subject->volume;
                            },
                            1);
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
                        take(
                            message.header(),
                            [&](Shown& shown) {
                                if (message.subjects_size() > 0 && message.subjects(0).has_pose())
                                    shown.pose = message.subjects(0).pose().SerializeAsString();
                            },
                            2);
                        return true;
                    },
                    options)
                .IgnoreError();
        });
        client::Client client({.server = address_});
        for (auto status = client.status(); status.ok(); status = client.status())
            if (status->volume_subscriber_count() > 0 && status->pose_subscriber_count() > 0) break;
    }

    // The next result for which `matches` is true, with its volume and its pose.
    Shown wait(const std::function<bool(const Shown&)>& matches) {
        std::unique_lock lock(mutex_);
        Shown found;
        const bool in_time = changed_.wait_for(lock, std::chrono::seconds(20), [&] {
            while (!waiting_.empty() && waiting_.front().second == 3) {
                const Shown shown = std::move(waiting_.front().first);
                waiting_.pop_front();
                if (!matches(shown)) continue;
                found = shown;
                return true;
            }
            return false;
        });
        EXPECT_TRUE(in_time) << "no result";
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
    std::deque<std::pair<Shown, int>> waiting_;  // and the streams it arrived on
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
        return session_config("127.0.0.1:0", "", "auto_fit_body = false\ndatabase_file = \"\"") +
               fmt::format(
                   "[calibration]\nfolder = \"calibrations\"\n[pipeline]\nvoxel_mm = 30\ncolouring = false\n"
                   "[replay]\nfolders = [\"{}\"]\n",
                   shared_->path().string());
    }
    static v1::OpenReplayRequest recording(const std::string& lease, bool paused) {
        v1::OpenReplayRequest request;
        request.set_lease_id(lease);
        request.set_session_path(recording_.string());
        request.set_paused(paused);
        return request;
    }
    static v1::UpdateReplayRequest seek(const std::string& lease, std::int64_t frame) {
        v1::UpdateReplayRequest request;
        request.set_lease_id(lease);
        request.set_frame(frame);
        return request;
    }

    // Overwrites entry `frame` of one camera's index with zeros.
    static void damage_index(const std::filesystem::path& recording, std::size_t frame) {
        for (const auto& entry : std::filesystem::directory_iterator(recording)) {
            if (entry.path().extension() != ".index") continue;
            std::fstream file(entry.path(), std::ios::binary | std::ios::in | std::ios::out);
            file.seekp(static_cast<std::streamoff>(kVideoIndexHeader.size() + frame * kVideoIndexEntryBytes));
            file << std::string(kVideoIndexEntryBytes, '\0');
            EXPECT_TRUE(file.good());
            return;
        }
        ADD_FAILURE() << recording << " has no index";
    }

    static inline std::filesystem::path recording_;
};

TEST_F(ReplayTest, StreamsShowRecordingThenCamerasAgain) {
    const auto daemon = start_daemon(config());
    Operator coach(address_);
    client::Client& client = coach.client();
    Follower follower(address_);
    follower.wait([](const Shown& shown) { return !shown.frame && shown.volume; });
    const std::vector<Camera> live = *client.cameras();

    const auto opened = client.open_replay("", recording(coach.lease(), true));
    ASSERT_TRUE(opened.ok()) << opened.status();
    EXPECT_EQ(opened->replay().frame_count(), kFrames);
    EXPECT_EQ(opened->replay().nominal_fps(), 20);
    const Shown first = follower.frame(0);
    EXPECT_EQ(*client.cameras(), *read_calibration(recording_.parent_path() / "calibration.toml"));
    const auto status = client.status();
    ASSERT_TRUE(status.ok());
    EXPECT_THAT(status->source(), HasSubstr("replay of"));
    EXPECT_EQ(status->state(), v1::CAPTURE_STATE_RUNNING);

    // A frame set shows the same result after each seek; the sequence keeps increasing.
    ASSERT_TRUE(client.update_replay("", seek(coach.lease(), 17)).ok());
    const Shown sought = follower.frame(17);
    ASSERT_TRUE(client.update_replay("", seek(coach.lease(), 4)).ok());
    follower.frame(4);
    v1::UpdateReplayRequest step;
    step.set_lease_id(coach.lease());
    step.set_step_frames(1);
    ASSERT_TRUE(client.update_replay("", step).ok());
    follower.frame(5);
    ASSERT_TRUE(client.update_replay("", seek(coach.lease(), 17)).ok());
    const Shown again = follower.frame(17);
    expect_same(sought, again);
    EXPECT_GT(again.sequence, sought.sequence);
    step.set_step_frames(-17);
    ASSERT_TRUE(client.update_replay("", step).ok());
    expect_same(first, follower.frame(0));
    EXPECT_EQ(client.get_replay()->replay().state(), v1::REPLAY_STATE_PAUSED);
    EXPECT_EQ(client.get_replay()->replay().discontinuity_count(), 4u);

    // Playback stops at the end.
    v1::UpdateReplayRequest play;
    play.set_lease_id(coach.lease());
    play.set_playing(true);
    ASSERT_TRUE(client.update_replay("", play).ok());
    follower.frame(kFrames - 1);
    EXPECT_EQ(client.get_replay()->replay().state(), v1::REPLAY_STATE_ENDED);
    EXPECT_EQ(client.status()->state(), v1::CAPTURE_STATE_RUNNING);

    // The live background is kept.
    ASSERT_TRUE(coach.client().release_control(coach.lease()).ok());
    ASSERT_TRUE(client.close_replay("coach").ok());
    follower.wait([](const Shown& shown) { return !shown.frame && shown.volume; });
    EXPECT_EQ(*client.cameras(), live);
    EXPECT_EQ(client.get_replay()->replay().state(), v1::REPLAY_STATE_LIVE);
    EXPECT_EQ(coach.events(v1::EVENT_KIND_REPLAY_OPENED, 1, std::chrono::seconds(10)).size(), 1u);
    EXPECT_EQ(coach.events(v1::EVENT_KIND_REPLAY_CLOSED, 1, std::chrono::seconds(10)).size(), 1u);
    EXPECT_EQ(coach.events(v1::EVENT_KIND_BACKGROUND_LEARNED, 2, std::chrono::seconds(10)).size(), 2u)
        << "one of the cameras, one of the recording";
    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(std::chrono::seconds(10)), 0);
}

TEST_F(ReplayTest, RejectsInvalidRequestsWithReason) {
    const auto daemon = start_daemon(config());
    Operator coach(address_);
    client::Client& client = coach.client();
    testing::wait_until_running(client);
    EXPECT_REFUSED(client.open_replay("other", recording("", true)), kFailedPrecondition, "coach");
    v1::OpenReplayRequest open = recording(coach.lease(), true);
    open.set_session_path("session.toml");
    EXPECT_REFUSED(client.open_replay("", open), kInvalidArgument, "is relative");
    open.set_session_path((recording_.parent_path() / "nowhere" / "session.toml").string());
    EXPECT_REFUSED(client.open_replay("", open), kNotFound, "nowhere/session.toml");
    open.clear_source();
    EXPECT_REFUSED(client.open_replay("", open), kInvalidArgument, "names no recording");
    open = recording(coach.lease(), true);
    open.set_speed(-1);
    EXPECT_REFUSED(client.open_replay("", open), kInvalidArgument, "speed");
    EXPECT_REFUSED(client.update_replay("", seek(coach.lease(), 0)), kFailedPrecondition,
                   "no replay is open");
    EXPECT_REFUSED(client.close_replay("other"), kFailedPrecondition, "coach");
    EXPECT_EQ(client.status()->state(), v1::CAPTURE_STATE_RUNNING) << "the cameras are unaffected";

    // Calibration and replay exclude each other.
    ASSERT_TRUE(coach.start(v1::PROCEDURE_KIND_INTRINSICS).ok());
    EXPECT_REFUSED(client.open_replay("", recording(coach.lease(), true)), kFailedPrecondition,
                   "calibration procedure");
    ASSERT_TRUE(coach.cancel().ok());
    ASSERT_TRUE(client.open_replay("", recording(coach.lease(), true)).ok());
    EXPECT_REFUSED(coach.start(v1::PROCEDURE_KIND_INTRINSICS), kFailedPrecondition, "replay close");
    EXPECT_REFUSED(coach.undo(false), kFailedPrecondition, "replay close");
    EXPECT_REFUSED(client.update_replay("", seek(coach.lease(), kFrames)), kOutOfRange, "0 to 29");
    v1::UpdateReplayRequest speed;
    speed.set_lease_id(coach.lease());
    speed.set_speed(1e6);
    EXPECT_REFUSED(client.update_replay("", speed), kOutOfRange, "speed");
}

TEST_F(ReplayTest, OpensSessionsInConfiguredFoldersOnly) {
    const auto outside = folder_.path() / "outside";
    std::filesystem::copy(recording_.parent_path(), outside, std::filesystem::copy_options::recursive);
    const auto daemon = start_daemon(config());
    client::Client client({.server = address_});
    testing::wait_until_running(client);
    v1::OpenReplayRequest open;
    const auto refused = [&](const std::filesystem::path& path) {
        open.set_session_path(path.string());
        EXPECT_REFUSED(client.open_replay("coach", open), kPermissionDenied, "[replay] folders");
    };
    refused(outside / "session.toml");
    refused(shared_->path() / ".." / folder_.path().filename() / "outside" / "session.toml");
    refused("/etc/passwd");
    const auto link = shared_->path() / "link";
    std::filesystem::create_directory_symlink(outside, link);
    refused(link / "session.toml");
    std::filesystem::remove(link);
    open.set_session_path(recording_.string());
    EXPECT_TRUE(client.open_replay("coach", open).ok());
}

TEST_F(ReplayTest, OpensRecordingByNameAndPreventsRecording) {
    const std::string recording_config =
        fmt::format("[recording]\nfolder = \"{}\"\nmax_buffer_s = 1\nmin_free_disk_mb = 0\n",
                    (folder_.path() / "kept").string());
    auto daemon = start_daemon(config() + recording_config);
    {
        client::Client client({.server = address_});
        testing::wait_until_running(client);
        v1::OpenReplayRequest open;
        open.set_paused(true);
        open.set_recording_name("walk");
        EXPECT_REFUSED(client.open_replay("coach", open), kNotFound, "recordings: none");
        v1::StartRecordingRequest start;
        start.set_name("walk");
        v1::SaveBufferRequest save;
        const auto started = client.start_recording("coach", start);
        ASSERT_TRUE(started.ok()) << started.status();
        EXPECT_REFUSED(client.open_replay("coach", open), kFailedPrecondition, "\"walk\" is being recorded");
        EXPECT_REFUSED(client.open_replay("coach", recording("", true)), kFailedPrecondition,
                       "kinevox record stop");
        const auto recorded = [&] {
            for (int i = 0; i < testing::patient(400);
                 ++i, std::this_thread::sleep_for(std::chrono::milliseconds(25)))
                if (const auto now = client.recorder_status();
                    now.ok() && now->current().frame_set_count() >= 10)
                    return true;
            return false;
        };
        ASSERT_TRUE(recorded());
        ASSERT_TRUE(client.stop_recording("coach", std::chrono::seconds(20)).ok());

        const auto shown = kinevox({"replay", "open", "walk", "--paused"});
        EXPECT_EQ(shown.status, 0) << shown.errors;
        EXPECT_THAT(shown.output, HasSubstr("kept/walk/session.toml"));
        start.set_name("again");
        EXPECT_REFUSED(client.start_recording("coach", start), kFailedPrecondition, "kinevox replay close");
        EXPECT_REFUSED(client.save_buffer("coach", save, std::chrono::seconds(20)), kFailedPrecondition,
                       "kinevox replay close");
        const auto none = kinevox({"replay", "open", "run"});
        EXPECT_EQ(none.status, 1);
        EXPECT_THAT(none.errors, AllOf(HasSubstr("no recording 'run'"), HasSubstr("recordings: walk")));
        EXPECT_THAT(kinevox({"replay", "open", "./run"}).errors, HasSubstr("[replay] folders"));
        ASSERT_TRUE(client.close_replay("coach").ok());
        start.set_name("killed");
        ASSERT_TRUE(client.start_recording("coach", start).ok()) << "after the replay";
        ASSERT_TRUE(recorded());
    }
    daemon->signal(SIGKILL);
    daemon->wait(std::chrono::seconds(10));

    daemon = start_daemon(config() + recording_config);
    client::Client client({.server = address_});
    Follower follower(address_);
    v1::OpenReplayRequest open;
    open.set_recording_name("killed");
    open.set_paused(true);
    const auto opened = client.open_replay("coach", open);
    ASSERT_TRUE(opened.ok()) << opened.status();
    EXPECT_GE(opened->replay().frame_count(), 9);
    EXPECT_TRUE(follower.frame(0).volume);
    const auto list = client.list_recordings();
    ASSERT_TRUE(list.ok()) << list.status();
    ASSERT_EQ(list->recordings_size(), 2);
    EXPECT_TRUE(list->recordings(1).closed() && list->recordings(1).recovered());

    damage_index(folder_.path() / "kept" / "walk", 4);
    open.set_recording_name("walk");
    EXPECT_REFUSED(client.open_replay("coach", open), kDataLoss, "damaged after 4 of");
}

TEST_F(ReplayTest, IsControlledFromTheCommandLine) {
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
             {{"seek", "later"}, "give a frame"},
             {{"seek", "99"}, "0 to 29"},
             {{"open", (recording_.parent_path() / "nowhere.toml").string()}, "nowhere"}}) {
        const auto refused = replay(words);
        EXPECT_EQ(refused.status, 1);
        EXPECT_THAT(refused.errors, HasSubstr(why));
    }
    EXPECT_EQ(replay({"close"}).output, "live\n");
    EXPECT_THAT(replay({"close"}).errors, HasSubstr("no replay is open"));
}

}  // namespace
}  // namespace kinevox
