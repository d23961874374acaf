// What the daemon reports: to the service manager that an idle pipeline is healthy and a hung one is not, in
// the log the subscribers and an unwritable folder.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include <boost/asio/io_context.hpp>
#include <condition_variable>
#include <functional>
#include <sstream>

#include "server/daemon/service_timer.h"
#include "server/daemon/setup.h"
#include "server/daemon/stored_background.h"
#include "server/daemon/timers.h"
#include "server/pipeline/runner.h"
#include "tests/support/fake_capture.h"
#include "tests/support/person_volume.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using namespace std::chrono_literals;
using Signal = Watchdog::Signal;

TEST(Watchdog, ReportsIdlePipelineAlive) {
    Watchdog watchdog(20s);
    for (int n = 0; n < 100; ++n) EXPECT_EQ(watchdog.check(0s), Signal::kAlive);
    EXPECT_EQ(watchdog.check(9s), Signal::kAlive);  // slow, but not hung
}

TEST(Watchdog, ReportsHungPipelineOnce) {
    Watchdog watchdog(20s);
    EXPECT_EQ(watchdog.check(9900ms), Signal::kAlive);
    EXPECT_EQ(watchdog.check(10s), Signal::kHung);
    EXPECT_EQ(watchdog.check(11s), Signal::kNone);  // no signal any more
    EXPECT_EQ(watchdog.check(1000s), Signal::kNone);
    EXPECT_EQ(watchdog.check(10ms), Signal::kAlive);  // it finished after all
    EXPECT_EQ(watchdog.check(10s), Signal::kHung);
}

TEST(Watchdog, IsSilentWithoutServiceManager) {
    Watchdog watchdog(0s);
    EXPECT_EQ(watchdog.check(0s), Signal::kNone);
    EXPECT_EQ(watchdog.check(1h), Signal::kNone);
    EXPECT_EQ(watchdog.period(), 1s);
}

TEST(Watchdog, ChecksFourTimesPerInterval) {
    EXPECT_EQ(Watchdog(20s).period(), 1s);
    EXPECT_EQ(Watchdog(1s).period(), 250ms);
}

bool within_deadline(const std::function<bool()>& holds) {
    const auto end = std::chrono::steady_clock::now() + 30s;
    while (!holds()) {
        if (std::chrono::steady_clock::now() > end) return false;
        std::this_thread::yield();
    }
    return true;
}

// A pipeline that the test stops in one of its halves.
class HungRunnerTest : public ::testing::TestWithParam<const char*> {
  protected:
    void hold() {
        std::unique_lock lock(mutex_);
        entered_ = true;
        changed_.notify_all();
        changed_.wait(lock, [&] { return released_; });
    }
    void wait_until_held() {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return entered_; });
    }
    void release() {
        const std::scoped_lock lock(mutex_);
        released_ = true;
        changed_.notify_all();
    }

    std::mutex mutex_;
    std::condition_variable changed_;
    bool entered_ = false, released_ = false;
};

TEST_P(HungRunnerTest, IsBusyUntilFrameSetIsFinished) {
    auto pipeline =
        std::make_unique<testing::FakePipeline>(std::make_shared<const Volume>(testing::person_volume(0.05)));
    const auto block = [this](std::uint64_t sequence) {
        if (sequence == 1) hold();
    };
    (std::string(GetParam()) == "pose" ? pipeline->on_pose : pipeline->on_reconstruct) = block;
    testing::FakeSourceControl source;
    StreamHub hub;
    Runner runner(
        source.open(), [&] { return source.open(); }, std::move(pipeline), hub);
    const auto in = [](auto time) { return BusyTimer::Clock::now() + time; };
    EXPECT_EQ(runner.max_busy_time(in(1h)), 0s) << "not started";
    ASSERT_TRUE(runner.start().ok());
    source.give(1);
    ASSERT_TRUE(within_deadline([&] { return runner.snapshot().result_count >= 1; }));
    ASSERT_TRUE(within_deadline([&] { return runner.max_busy_time(in(1h)) == 0s; })) << "waits for images";
    source.give(5);
    wait_until_held();
    EXPECT_GE(runner.max_busy_time(in(1h)), 1h);
    EXPECT_LT(runner.max_busy_time(in(1h)), 1h + 60s);
    release();
    ASSERT_TRUE(within_deadline([&] { return runner.snapshot().result_count >= 6; }));
    ASSERT_TRUE(within_deadline([&] { return runner.max_busy_time(in(1h)) == 0s; }));
    ASSERT_TRUE(runner.stop().ok());
    EXPECT_EQ(runner.max_busy_time(in(1h)), 0s) << "stopped";
}

INSTANTIATE_TEST_SUITE_P(Halves, HungRunnerTest, ::testing::Values("reconstruct", "pose"));

TEST(StatusLog, CountsAllSubscribers) {
    std::ostringstream lines;
    const auto before = spdlog::default_logger();
    spdlog::set_default_logger(
        std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(lines)));
    {
        testing::FakeSourceControl source;
        StreamHub hub;
        Runner runner(
            source.open(), [&] { return source.open(); },
            std::make_unique<testing::FakePipeline>(
                std::make_shared<const Volume>(testing::person_volume(0.05))),
            hub);
        const auto volumes = hub.subscribe_volumes({}, [] {});
        const auto poses = hub.subscribe_poses({}, [] {}), more_poses = hub.subscribe_poses({}, [] {});
        const auto images = hub.subscribe_images([] {});
        const auto events = hub.events().subscribe(0, [] {});
        ASSERT_TRUE(runner.start().ok());
        source.give(1);
        ASSERT_TRUE(within_deadline([&] { return runner.snapshot().result_count >= 1; }));
        boost::asio::io_context io;
        StatusLog log(io, runner, hub);
        io.run_for(1500ms);
        log.stop();
    }
    spdlog::set_default_logger(before);
    EXPECT_THAT(lines.str(), ::testing::HasSubstr("5 subscribers"));
}

TEST(RecordingsFolder, IsWarnedOfIfNotWritable) {
    const testing::TemporaryFolder folder;
    EXPECT_EQ(unwritable_reason(folder.path()), "");
    EXPECT_EQ(unwritable_reason(folder.path() / "not" / "yet"), "");
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "not")) << "nothing is created";
    folder.write("file", "");
    EXPECT_THAT(unwritable_reason(folder.path() / "file" / "recordings"),
                ::testing::HasSubstr("is no folder"));
}

std::vector<std::vector<Image>> noisy_scene(const std::vector<Camera>& cameras, int count) {
    std::vector<std::vector<Image>> out(cameras.size());
    unsigned random = 1;
    for (std::size_t c = 0; c < cameras.size(); ++c)
        for (int n = 0; n < count; ++n) {
            const std::size_t bytes = std::size_t{3} * cameras[c].width * cameras[c].height;
            auto data = std::make_shared<std::uint8_t[]>(bytes);
            for (std::size_t i = 0; i < bytes; ++i)
                data[i] = static_cast<std::uint8_t>((random = random * 1664525u + 1013904223u) >> 24);
            out[c].push_back({cameras[c].width, cameras[c].height, 3, data});
        }
    return out;
}

class StoredBackgroundTest : public ::testing::Test {
  protected:
    StoredBackground::OnMessage on_message() {
        return [this](const std::string& message) {
            const std::scoped_lock lock(mutex_);
            messages_ += message + "\n";
        };
    }
    std::filesystem::path folder() const { return folder_.path() / "background"; }
    std::string messages() const {
        const std::scoped_lock lock(mutex_);
        return messages_;
    }

    void store(const std::vector<Camera>& cameras, const std::vector<std::vector<Image>>& images) {
        StoredBackground background(folder(), on_message());
        background.store(cameras, 30, std::make_shared<const std::vector<std::vector<Image>>>(images));
        const auto newest = folder() / (cameras.back().name + ".mkv");
        const auto before = std::filesystem::exists(newest) ? std::filesystem::last_write_time(newest)
                                                            : std::filesystem::file_time_type{};
        for (int n = 0; n < 2000; ++n) {  // it is put in place at once
            std::error_code error;
            if (std::filesystem::exists(newest, error) &&
                std::filesystem::last_write_time(newest, error) != before)
                return;
            std::this_thread::sleep_for(10ms);
        }
        ADD_FAILURE() << "not stored: " << messages();
    }

    testing::TemporaryFolder folder_;
    mutable std::mutex mutex_;
    std::string messages_;
};

TEST_F(StoredBackgroundTest, RestoresSameImages) {
    const auto cameras = testing::fake_cameras();
    const auto images = noisy_scene(cameras, 70);  // more than a session's clip would give
    store(cameras, noisy_scene(cameras, 2));
    store(cameras, images);
    StoredBackground again(folder(), on_message());
    const auto read = again.read(cameras);
    ASSERT_EQ(read.size(), cameras.size()) << messages();
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        ASSERT_EQ(read[c].size(), images[c].size());
        for (std::size_t n = 0; n < read[c].size(); ++n)
            ASSERT_TRUE(std::equal(read[c][n].data.get(),
                                   read[c][n].data.get() + 3 * cameras[c].width * cameras[c].height,
                                   images[c][n].data.get()))
                << c << " " << n;
    }
    EXPECT_THAT(messages(), ::testing::HasSubstr("relearn it if the scene has changed"));
}

TEST_F(StoredBackgroundTest, RejectsOtherCameras) {
    auto cameras = testing::fake_cameras();
    store(cameras, noisy_scene(cameras, 2));
    StoredBackground again(folder(), on_message());
    auto others = cameras;
    others[1].name = "above";
    EXPECT_TRUE(again.read(others).empty());
    EXPECT_THAT(messages(), ::testing::HasSubstr("missing: above"));
    others = cameras;
    others[1].width *= 2;
    EXPECT_TRUE(again.read(others).empty());
    EXPECT_THAT(messages(), ::testing::HasSubstr("cannot be used"));
}

TEST_F(StoredBackgroundTest, RestoresOnlyWithoutOwnBackground) {
    const auto cameras = testing::fake_cameras();
    store(cameras, noisy_scene(cameras, 3));
    StoredBackground again(folder(), on_message());
    testing::FakeSourceControl source;
    EXPECT_EQ(again.restoring(source.open())->background()->front().size(), 2u);  // its own
    source.with_background = false;
    EXPECT_EQ(again.restoring(source.open())->background()->front().size(), 3u);
    StoredBackground nowhere({}, on_message());
    EXPECT_TRUE(nowhere.restoring(source.open())->background()->empty());
}

}  // namespace
}  // namespace kinevox
