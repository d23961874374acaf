// What the service manager is told: an idle pipeline is well, one that keeps a frame set in hand is not.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <condition_variable>

#include "server/daemon/stored_background.h"
#include "server/daemon/watchdog.h"
#include "server/pipeline/runner.h"
#include "tests/support/fake_capture.h"
#include "tests/support/person_volume.h"
#include "tests/unit/common/temporary_folder.h"

namespace kinevox {
namespace {

using namespace std::chrono_literals;
using Word = Watchdog::Word;

TEST(Watchdog, AnIdlePipelineIsAlive) {
    Watchdog watchdog(20s);
    for (int n = 0; n < 100; ++n) EXPECT_EQ(watchdog.look(0s), Word::kAlive);
    EXPECT_EQ(watchdog.look(9s), Word::kAlive);  // slow, but not hung
}

TEST(Watchdog, AFrameSetThatDoesNotComeOutIsToldOnce) {
    Watchdog watchdog(20s);
    EXPECT_EQ(watchdog.look(9900ms), Word::kAlive);
    EXPECT_EQ(watchdog.look(10s), Word::kHung);
    EXPECT_EQ(watchdog.look(11s), Word::kNone);  // and not fed any more
    EXPECT_EQ(watchdog.look(1000s), Word::kNone);
    EXPECT_EQ(watchdog.look(10ms), Word::kAlive);  // it came out after all
    EXPECT_EQ(watchdog.look(10s), Word::kHung);
}

TEST(Watchdog, IsSilentWhereNobodyWatches) {
    Watchdog watchdog(0s);
    EXPECT_EQ(watchdog.look(0s), Word::kNone);
    EXPECT_EQ(watchdog.look(1h), Word::kNone);
    EXPECT_EQ(watchdog.period(), 1s);
}

TEST(Watchdog, LooksOftenEnough) {
    EXPECT_EQ(Watchdog(20s).period(), 1s);
    EXPECT_EQ(Watchdog(1s).period(), 250ms);
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

TEST_P(HungRunnerTest, HasItsFrameSetInHandUntilItComesOut) {
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
    const auto in = [](auto time) { return InHand::Clock::now() + time; };
    EXPECT_EQ(runner.max_in_hand(in(1h)), 0s) << "not started";
    ASSERT_TRUE(runner.start().ok());
    source.give(1);
    while (runner.figures().results < 1) std::this_thread::yield();
    while (runner.max_in_hand(in(1h)) != 0s) std::this_thread::yield();  // waits for pictures, however long
    source.give(5);
    wait_until_held();
    EXPECT_GE(runner.max_in_hand(in(1h)), 1h);
    EXPECT_LT(runner.max_in_hand(in(1h)), 1h + 60s);
    release();
    while (runner.figures().results < 6) std::this_thread::yield();
    while (runner.max_in_hand(in(1h)) != 0s) std::this_thread::yield();
    ASSERT_TRUE(runner.stop().ok());
    EXPECT_EQ(runner.max_in_hand(in(1h)), 0s) << "stopped";
}

INSTANTIATE_TEST_SUITE_P(Halves, HungRunnerTest, ::testing::Values("reconstruct", "pose"));

std::vector<std::vector<Picture>> noisy_scene(const std::vector<Camera>& cameras, int count) {
    std::vector<std::vector<Picture>> out(cameras.size());
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
    StoredBackground::Tell tell() {
        return [this](const std::string& words) {
            const std::scoped_lock lock(mutex_);
            told_ += words + "\n";
        };
    }
    std::filesystem::path folder() const { return folder_.path() / "background"; }
    std::string told() const {
        const std::scoped_lock lock(mutex_);
        return told_;
    }

    void store(const std::vector<Camera>& cameras, const std::vector<std::vector<Picture>>& pictures) {
        StoredBackground background(folder(), tell());
        background.store(cameras, 30, std::make_shared<const std::vector<std::vector<Picture>>>(pictures));
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
        ADD_FAILURE() << "not stored: " << told();
    }

    testing::TemporaryFolder folder_;
    mutable std::mutex mutex_;
    std::string told_;
};

TEST_F(StoredBackgroundTest, IsTheSameAfterARestart) {
    const auto cameras = testing::fake_cameras();
    const auto pictures = noisy_scene(cameras, 70);  // more than a session's clip would give
    store(cameras, noisy_scene(cameras, 2));
    store(cameras, pictures);
    StoredBackground again(folder(), tell());
    const auto read = again.read(cameras);
    ASSERT_EQ(read.size(), cameras.size()) << told();
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        ASSERT_EQ(read[c].size(), pictures[c].size());
        for (std::size_t n = 0; n < read[c].size(); ++n)
            ASSERT_TRUE(std::equal(read[c][n].data.get(),
                                   read[c][n].data.get() + 3 * cameras[c].width * cameras[c].height,
                                   pictures[c][n].data.get()))
                << c << " " << n;
    }
    EXPECT_THAT(told(), ::testing::HasSubstr("is used; where the scene has changed"));
}

TEST_F(StoredBackgroundTest, OfOtherCamerasIsNotUsed) {
    auto cameras = testing::fake_cameras();
    store(cameras, noisy_scene(cameras, 2));
    StoredBackground again(folder(), tell());
    auto others = cameras;
    others[1].name = "above";
    EXPECT_TRUE(again.read(others).empty());
    EXPECT_THAT(told(), ::testing::HasSubstr("lacks above"));
    others = cameras;
    others[1].width *= 2;
    EXPECT_TRUE(again.read(others).empty());
    EXPECT_THAT(told(), ::testing::HasSubstr("the stored background is not used"));
}

TEST_F(StoredBackgroundTest, RestoresOnlyWhereTheSourceHasNone) {
    const auto cameras = testing::fake_cameras();
    store(cameras, noisy_scene(cameras, 3));
    StoredBackground again(folder(), tell());
    testing::FakeSourceControl source;
    EXPECT_EQ(again.restoring(source.open())->background()->front().size(), 2u);  // its own
    source.with_background = false;
    EXPECT_EQ(again.restoring(source.open())->background()->front().size(), 3u);
    StoredBackground nowhere({}, tell());
    EXPECT_TRUE(nowhere.restoring(source.open())->background()->empty());
}

}  // namespace
}  // namespace kinevox
