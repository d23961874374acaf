// kinevoxd as a process: its start, its end, and what it says when something is wrong.
#include <gmock/gmock.h>
#include <signal.h>

#include <algorithm>
#include <atomic>
#include <future>
#include <thread>

#include "tests/integration/daemon/daemon_fixture.h"
#include "tests/support/patience.h"

namespace kinevox {
namespace {

using ::testing::AllOf;
using testing::ChildProcess;
using testing::DaemonTest;
using ::testing::HasSubstr;

// 0: no subject, or none with a volume.
double volume_litres(const v1::GetStatusResponse& status) {
    return status.subjects_size() > 0 ? status.subjects(0).volume().volume_litres() : 0;
}

TEST_F(DaemonTest, ServesSessionUntilSigterm) {
    const auto daemon = start_daemon(session_config("127.0.0.1:0", "loop = true\n"));
    client::Client client({.server = address_});
    wait_for_a_volume(client);
    auto status = client.status();
    // Where results are lost, this subject's turns are too sharp for every frame to have a volume.
    for (int asked = 1; asked < 100 && status.ok() && volume_litres(*status) == 0; ++asked) {
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
        status = client.status();
    }
    ASSERT_TRUE(status.ok()) << status.status();
    EXPECT_EQ(status->state(), v1::CAPTURE_STATE_RUNNING);
    EXPECT_EQ(status->cameras_size(), 4);
    EXPECT_GT(volume_litres(*status), 50);
    EXPECT_LT(volume_litres(*status), 250);

    // A stream in progress ends with words, within the two seconds.
    // The one that waited for a volume may still be leaving.
    EXPECT_TRUE(testing::eventually([&] { return client.status()->volume_subscriber_count() == 0; }));
    auto stream = std::async(std::launch::async,
                             [&] { return client.stream_volumes({}, [](const auto&) { return true; }, {}); });
    EXPECT_TRUE(testing::eventually([&] { return client.status()->volume_subscriber_count() != 0; }));
    const auto begin = std::chrono::steady_clock::now();
    daemon->signal(SIGTERM);
    daemon->signal(SIGTERM);  // a second one changes nothing
    EXPECT_EQ(daemon->wait(std::chrono::milliseconds(2000)), 0) << daemon->errors();
    RecordProperty("stopped_within_ms",
                   static_cast<int>(std::chrono::duration_cast<std::chrono::milliseconds>(
                                        std::chrono::steady_clock::now() - begin)
                                        .count()));
    const absl::Status ended = stream.get();
    EXPECT_EQ(ended.code(), absl::StatusCode::kUnavailable);
    EXPECT_THAT(std::string(ended.message()), HasSubstr("the daemon is stopping"));
    EXPECT_EQ(daemon->output(), "ready on " + address_ + "\n") << "nothing else on standard output";
}

// gRPC ends a call that it takes while it stops with CANCELLED, which for a client means that it stopped by
// itself: it would leave without an error, and not connect again.
TEST_F(DaemonTest, AnswersUnavailableWhileStopping) {
    const auto daemon = start_daemon(session_config("127.0.0.1:0", "autostart = false\n"));
    std::atomic<bool> begun = false;
    const auto call_until_it_fails = [&](bool stream) {
        client::Client client({.server = address_});
        for (;;) {
            const absl::Status ended = stream ? client.watch_events({}, [](const auto&) { return false; }, {})
                                              : client.status().status();
            begun = true;
            if (!ended.ok()) return ended;
        }
    };
    std::vector<std::future<absl::Status>> callers;
    for (int n = 0; n < 16; ++n)
        callers.push_back(std::async(std::launch::async, call_until_it_fails, n % 2 == 1));
    EXPECT_TRUE(testing::eventually([&] { return begun.load(); })) << "no call was answered";
    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(std::chrono::milliseconds(2000)), 0) << daemon->errors();
    for (auto& caller : callers) {
        const absl::Status ended = caller.get();
        EXPECT_EQ(ended.code(), absl::StatusCode::kUnavailable) << ended;
    }
}

TEST_F(DaemonTest, StopsInTimeWithIdleSubscriber) {
    const auto daemon = start_daemon(session_config("127.0.0.1:0"));
    client::Client client({.server = address_});
    std::promise<void> first, leave;
    auto stream = std::async(std::launch::async, [&] {
        bool notified = false;
        return client.stream_volumes(
            {},
            [&](const auto&) {
                if (!std::exchange(notified, true)) first.set_value();
                leave.get_future().wait();  // reads nothing more until the daemon is gone
                return false;
            },
            {});
    });
    first.get_future().wait();
    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(std::chrono::milliseconds(2000)), 0) << daemon->errors();
    leave.set_value();
    stream.get().IgnoreError();
}

// A rate limit is a timer that is pending when the daemon stops.
TEST_F(DaemonTest, StopsInTimeWithSlowSubscriber) {
    const auto daemon = start_daemon(session_config("127.0.0.1:0", "loop = true\n"));
    client::Client client({.server = address_});
    v1::StreamVolumesRequest few;
    few.set_max_rate_hz(0.1);
    std::promise<void> first;
    auto stream = std::async(std::launch::async, [&, notified = false]() mutable {
        return client.stream_volumes(few,
                                     [&](const auto&) {
                                         if (!std::exchange(notified, true)) first.set_value();
                                         return true;
                                     },
                                     {});
    });
    first.get_future().wait();
    std::this_thread::sleep_for(
        std::chrono::milliseconds(300));  // until the next result is ready and has to wait
    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(std::chrono::milliseconds(2000)), 0) << daemon->errors();
    stream.get().IgnoreError();
}

TEST_F(DaemonTest, FailsIfPortIsInUse) {
    const auto daemon = start_daemon(session_config("127.0.0.1:0", "autostart = false\n"));
    const auto file = write("second.toml", session_config(address_));
    const auto second = testing::run({KINEVOX_DAEMON, "--config", file.string()}, folder_.path());
    EXPECT_EQ(second.status, 1);
    EXPECT_EQ(std::ranges::count(second.errors, '\n'), 1) << second.errors;
    EXPECT_THAT(second.errors, AllOf(HasSubstr(address_), HasSubstr("in use"), HasSubstr("[server]")));
    EXPECT_EQ(second.output, "");
    client::Client client({.server = address_});
    EXPECT_EQ(client.status()->state(), v1::CAPTURE_STATE_STOPPED)
        << "the first continues, and waits as configured";
}

TEST_F(DaemonTest, ReportsStartErrorsInOneLine) {
    const auto wrong_calibration = [&] {  // cam3 is missing from the session's calibration
        std::filesystem::copy(session_.parent_path(), folder_.path() / "copy",
                              std::filesystem::copy_options::recursive);
        std::filesystem::remove_all(folder_.path() / "copy/cam3");
        return (folder_.path() / "copy/session.toml").string();
    }();
    const struct {
        const char* name;
        std::string config;
        std::vector<std::string> said;
    } kTable[] = {
        {"unknown key", "[server]\nlissten = \"127.0.0.1:0\"\n", {"bad.toml:2", "lissten"}},
        {"wrong type", "[pipeline]\nvoxel_mm = \"ten\"\n", {"bad.toml:2", "voxel_mm"}},
        {"no TOML", "[server\n", {"bad.toml:1"}},
        {"missing session",
         "[source]\nkind = \"session\"\nsession_file = \"nowhere.toml\"\n",
         {"nowhere.toml"}},
        {"missing images",
         "[source]\nkind = \"session\"\nsession_file = \"" + wrong_calibration + "\"\n",
         {"cam3"}},
        {"no address of this machine", session_config("192.0.2.1:50771"), {"192.0.2.1:50771"}},
        {"log that cannot be written",
         session_config("127.0.0.1:0", "[log]\nfile = \"/proc/no/log\"\n"),
         {"/proc/no/log"}},
    };
    for (const auto& row : kTable) {
        const auto file = write("bad.toml", row.config);
        const auto ran = testing::run({KINEVOX_DAEMON, "--config", file.string()}, folder_.path());
        EXPECT_EQ(ran.status, 1) << row.name;
        EXPECT_EQ(std::ranges::count(ran.errors, '\n'), 1) << row.name << ": " << ran.errors;
        EXPECT_EQ(ran.output, "") << row.name;
        for (const std::string& said : row.said) EXPECT_THAT(ran.errors, HasSubstr(said)) << row.name;
    }
    const auto missing = testing::run({KINEVOX_DAEMON, "--config", "/nowhere/kinevoxd.toml"}, folder_.path());
    EXPECT_EQ(missing.status, 1);
    EXPECT_THAT(missing.errors, HasSubstr("/nowhere/kinevoxd.toml"));
    const auto flag = testing::run({KINEVOX_DAEMON, "--verbose"}, folder_.path());
    EXPECT_EQ(flag.status, 1);
    EXPECT_THAT(flag.errors, HasSubstr("--verbose"));
}

TEST_F(DaemonTest, ExpiresLeaseOfDisconnectedOperator) {
    const auto daemon =
        start_daemon(session_config("127.0.0.1:0", "autostart = false\n[control]\ndefault_lease_s = 1.0\n"));
    client::Client client({.server = address_});
    v1::AcquireControlRequest request;
    request.set_operator_name("ann");
    ASSERT_TRUE(client.acquire_control(request).ok());
    v1::WatchEventsRequest watch;
    watch.set_history_count(1);
    std::vector<std::string> messages;
    client::StreamOptions options;
    options.idle_timeout = std::chrono::seconds(10);
    ASSERT_TRUE(client
                    .watch_events(
                        watch,
                        [&](const auto& message) {
                            messages.push_back(message.event().message());
                            return message.event().kind() != v1::EVENT_KIND_CONTROL_RELEASED;
                        },
                        options)
                    .ok());
    EXPECT_THAT(messages.back(), HasSubstr("'ann' has expired"));
    EXPECT_TRUE(client.start("bob").ok());
}

// Waits for an event of this kind, also one from before.
std::string message_of(client::Client& client, v1::EventKind kind) {
    v1::WatchEventsRequest watch;
    watch.set_history_count(100);
    client::StreamOptions options;
    options.idle_timeout = std::chrono::seconds(30);
    std::string message;
    EXPECT_TRUE(client
                    .watch_events(
                        watch,
                        [&](const v1::WatchEventsResponse& received) {
                            if (received.event().kind() == kind) message = received.event().message();
                            return message.empty();
                        },
                        options)
                    .ok());
    return message;
}

TEST_F(DaemonTest, BuildsPoseDatabaseOnce) {
    const auto file = folder_.path() / "state/poses.kvxposes";
    const std::string pose = "database_file = \"state/poses.kvxposes\"\nlibrary_pose_count = 30";
    for (const char* said : {"did not exist", "read from its file"}) {
        const auto daemon = start_daemon(session_config("127.0.0.1:0", "", pose));
        client::Client client({.server = address_});
        EXPECT_THAT(message_of(client, v1::EVENT_KIND_POSE_DATABASE_READY),
                    AllOf(HasSubstr("2160 entries"), HasSubstr(said)));
        EXPECT_TRUE(std::filesystem::exists(file));
        wait_for_a_volume(client);  // with candidates from it
        daemon->signal(SIGTERM);
        EXPECT_EQ(daemon->wait(std::chrono::milliseconds(2000)), 0) << daemon->errors();
    }
    // Damage is reported and repaired.
    std::filesystem::resize_file(file, 1000);
    const auto daemon = start_daemon(session_config("127.0.0.1:0", "", pose));
    client::Client client({.server = address_});
    EXPECT_THAT(message_of(client, v1::EVENT_KIND_POSE_DATABASE_READY), HasSubstr("poses.kvxposes"));
}

// Right after "ready" the background is learned, the database and the pose stage come up.
TEST_F(DaemonTest, StopsInTimeAtAnySignal) {
    const std::string pose = "database_file = \"poses.kvxposes\"\nlibrary_pose_count = 1400";
    for (const int after_ms : {0, 20, 60, 150, 300, 600, 1200}) {
        const auto daemon = start_daemon(session_config("127.0.0.1:0", "", pose));
        std::this_thread::sleep_for(std::chrono::milliseconds(after_ms));  // the time of the signal is tested
        daemon->signal(SIGTERM);
        EXPECT_EQ(daemon->wait(std::chrono::milliseconds(2000)), 0)
            << after_ms << " ms: " << daemon->errors();
    }
}

TEST_F(DaemonTest, StopsInTimeDuringDatabaseBuild) {
    const auto daemon = start_daemon(
        session_config("127.0.0.1:0", "", "database_file = \"poses.kvxposes\"\nlibrary_pose_count = 1400"));
    client::Client client({.server = address_});
    wait_for_a_volume(client);
    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(std::chrono::milliseconds(2000)), 0) << daemon->errors();
    EXPECT_FALSE(std::filesystem::exists(folder_.path() / "poses.kvxposes"));
}

}  // namespace
}  // namespace kinevox
