// A recording that is replayed: every frame set is the right one, wherever it was sought.
#include "server/cameras/replay_source.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <future>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <thread>

#include "common/calibration_file.h"
#include "server/cameras/h264_file.h"
#include "server/cameras/session_source.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;

constexpr int kWidth = 64, kHeight = 48, kFrames = 100;
constexpr double kFps = 200;

// The frame's number in two grey levels, left and right; compression changes them by less than half a step.
cv::Mat numbered(int frame) {
    cv::Mat image(kHeight, kWidth, CV_8UC3, cv::Scalar::all(20 + 20 * (frame / 10)));
    image(cv::Rect(kWidth / 2, 0, kWidth / 2, kHeight)) = cv::Scalar::all(20 + 20 * (frame % 10));
    return image;
}
int number_in(const Image& image) {
    const auto level = [&](int x) {
        return static_cast<int>(std::lround((image.data[3 * (image.width * (kHeight / 2) + x)] - 20) / 20.0));
    };
    return 10 * level(kWidth / 4) + level(3 * kWidth / 4);
}

// Three cameras: H.264 with a key frame every 30, FFV1, and a folder of images.
class ReplaySourceTest : public ::testing::Test {
  protected:
    static void SetUpTestSuite() {
        silence_video_libraries();
        shared_ = new testing::TemporaryFolder;
        const std::filesystem::path folder = shared_->path();
        std::vector<Camera> cameras(3);
        std::string session =
            fmt::format("name = \"numbered\"\nfps = {}\ncalibration = \"calibration.toml\"\n", kFps);
        const char* const names[] = {"h264", "ffv1", "folder"};
        const char* const files[] = {"h264.mp4", "ffv1.avi", "folder"};
        for (int c = 0; c < 3; ++c) {
            cameras[c].name = names[c];
            cameras[c].width = kWidth, cameras[c].height = kHeight;
            cameras[c].fx = cameras[c].fy = 60, cameras[c].cx = 31.5, cameras[c].cy = 23.5;
            session += fmt::format("[[camera]]\nname = \"{}\"\nvideo = \"{}\"\n", names[c], files[c]);
        }
        ASSERT_TRUE(write_calibration_toml(cameras, folder / "calibration.toml").ok());
        shared_->write("session.toml", session);
        auto h264 = H264File::create(folder / files[0], kWidth, kHeight, {.fps = kFps});
        ASSERT_TRUE(h264.ok()) << h264.status();
        cv::VideoWriter ffv1((folder / files[1]).string(), cv::CAP_FFMPEG,
                             cv::VideoWriter::fourcc('F', 'F', 'V', '1'), kFps, {kWidth, kHeight});
        ASSERT_TRUE(ffv1.isOpened());
        std::filesystem::create_directories(folder / files[2]);
        for (int frame = 0; frame < kFrames; ++frame) {
            const cv::Mat image = numbered(frame);
            const std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[image.total() * 3]);
            std::copy(image.data, image.data + image.total() * 3, data.get());
            ASSERT_TRUE((*h264)->write({kWidth, kHeight, 3, data}).ok());
            ffv1.write(image);
            cv::imwrite((folder / files[2] / fmt::format("{}.png", frame)).string(), image);
        }
        ASSERT_TRUE((*h264)->close().ok());
    }
    static void TearDownTestSuite() { delete shared_; }

    static std::shared_ptr<ReplaySource> open(const ReplayOptions& options = {}) {
        auto source = ReplaySource::open(shared_->path() / "session.toml", options);
        EXPECT_TRUE(source.ok()) << source.status();
        return source.ok() ? *source : nullptr;
    }

    static void expect_shows(const absl::StatusOr<FrameSet>& set, int frame) {
        ASSERT_TRUE(set.ok()) << set.status();
        EXPECT_EQ(set->recorded_frame, frame);
        EXPECT_EQ(set->capture_time_ns, static_cast<std::int64_t>(frame * 1e9 / kFps));
        ASSERT_EQ(set->images.size(), 3u);
        for (std::size_t c = 0; c < 3; ++c) EXPECT_EQ(number_in(set->images[c]), frame) << c;
    }

    static inline testing::TemporaryFolder* shared_ = nullptr;
};

TEST_F(ReplaySourceTest, PlaysAtSpeedAndWaitsAtEnd) {
    const auto source = open({.speed = 0.5});
    ASSERT_TRUE(source);
    const auto begun = std::chrono::steady_clock::now();
    int last = -1;
    std::uint64_t sequence = 0;
    while (last < kFrames - 1) {
        const auto set = source->next();
        ASSERT_TRUE(set.ok()) << set.status();
        expect_shows(set, static_cast<int>(*set->recorded_frame));
        EXPECT_FALSE(set->after_discontinuity);
        EXPECT_GT(*set->recorded_frame, last);
        EXPECT_EQ(set->sequence, static_cast<std::uint64_t>(*set->recorded_frame))
            << "skipped frame sets are a gap";
        last = static_cast<int>(*set->recorded_frame);
        sequence = set->sequence;
    }
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begun;
    EXPECT_GE(took.count(), 0.95 * (kFrames - 1) / kFps / 0.5);
    EXPECT_EQ(source->position().state, ReplayState::kEnded);
    EXPECT_EQ(source->position().discontinuity_count, 0u);

    auto after = std::async(std::launch::async, [&] { return source->next(); });
    EXPECT_EQ(after.wait_for(std::chrono::milliseconds(100)), std::future_status::timeout);
    source->play();  // from the begin
    const auto first = after.get();
    expect_shows(first, 0);
    EXPECT_TRUE(first->after_discontinuity);
    EXPECT_EQ(first->sequence, sequence + 1);
    source->set_loop(true);
    bool again = false;
    for (int k = 0; k < 2 * kFrames && !again; ++k) {
        const auto set = source->next();
        ASSERT_TRUE(set.ok());
        again = set->after_discontinuity;
        if (again) expect_shows(set, 0);
    }
    EXPECT_TRUE(again);
    source->stop();
    EXPECT_TRUE(absl::IsCancelled(source->next().status()));
}

TEST_F(ReplaySourceTest, SeeksAndStepsExactly) {
    const auto source = open({.paused = true});
    ASSERT_TRUE(source);
    expect_shows(source->next(), 0);
    EXPECT_EQ(source->position().state, ReplayState::kPaused);
    std::uint64_t sequence = 0;
    int at = 0;
    for (const int frame : {57, 58, 29, 30, 31, 99, 0, 3, 90, 12, 11, 11, 98}) {
        SCOPED_TRACE(frame);
        ASSERT_TRUE(source->seek(frame).ok());
        const auto set = source->next();
        expect_shows(set, frame);
        EXPECT_EQ(set->sequence, ++sequence);
        EXPECT_EQ(set->after_discontinuity, frame != at + 1);
        EXPECT_EQ(source->position().frame, frame);
        at = frame;
    }
    for (const int step : {1, 1, -1, -50, 7, 1, 1, 1, -1000}) {
        source->step(step);
        const auto set = source->next();
        const int frame = std::clamp(at + step, 0, kFrames - 1);
        expect_shows(set, frame);
        EXPECT_EQ(set->after_discontinuity, frame != at + 1);
        at = frame;
    }
    // As far as a request can ask: to the ends.
    source->step(std::numeric_limits<std::int64_t>::max());
    expect_shows(source->next(), kFrames - 1);
    source->step(std::numeric_limits<std::int64_t>::min());
    expect_shows(source->next(), 0);
    auto none = std::async(std::launch::async, [&] { return source->next(); });
    EXPECT_EQ(none.wait_for(std::chrono::milliseconds(50)), std::future_status::timeout) << "it stands still";
    source->stop();
    EXPECT_TRUE(absl::IsCancelled(none.get().status()));
}

TEST_F(ReplaySourceTest, SeekWhilePlayingContinuesFromLatestTarget) {
    const auto source = open({.loop = true, .speed = 0.2});
    ASSERT_TRUE(source);
    expect_shows(source->next(), 0);
    ASSERT_TRUE(source->seek(10).ok());
    ASSERT_TRUE(source->seek(70).ok());
    expect_shows(source->next(), 70);
    const auto next = source->next();
    expect_shows(next, 71);
    EXPECT_FALSE(next->after_discontinuity);
    EXPECT_EQ(source->position().discontinuity_count, 1u);
    source->step(2);  // on from what was shown last, and pauses
    expect_shows(source->next(), 73);
    EXPECT_EQ(source->position().state, ReplayState::kPaused);
}

TEST_F(ReplaySourceTest, StepsFromTargetThatIsBeingDecoded) {
    const auto source = open({.paused = true});
    ASSERT_TRUE(source);
    expect_shows(source->next(), 0);
    for (int frame = 3; frame < kFrames - 1; frame += 5) {
        SCOPED_TRACE(frame);
        auto reader = std::async(std::launch::async, [&] { return source->next(); });
        std::this_thread::sleep_for(std::chrono::milliseconds(1));  // the reader waits
        ASSERT_TRUE(source->seek(frame).ok());
        std::this_thread::sleep_for(std::chrono::microseconds(100));  // it decodes the target
        source->step(1);
        const auto set = reader.get();
        ASSERT_TRUE(set.ok()) << set.status();
        if (set->recorded_frame == frame)
            expect_shows(source->next(), frame + 1);  // the target was decoded before the step
        else
            expect_shows(set, frame + 1);
    }
}

TEST_F(ReplaySourceTest, SeekKeepsOffsetCamerasAligned) {
    std::string session = fmt::format("fps = {}\ncalibration = \"calibration.toml\"\n", kFps);
    const std::tuple<const char*, const char*, int> begun[] = {
        {"h264", "h264.mp4", 0}, {"ffv1", "ffv1.avi", 7}, {"folder", "folder", -3}};
    for (const auto& [name, file, frames] : begun)
        session += fmt::format("[[camera]]\nname = \"{}\"\nvideo = \"{}\"\noffset_s = {}\n", name, file,
                               frames / kFps);
    const auto source =
        ReplaySource::open(shared_->write("begun_one_by_one.toml", session), {.paused = true});
    ASSERT_TRUE(source.ok()) << source.status();
    ASSERT_TRUE((*source)->next().ok());
    EXPECT_EQ((*source)->position().frame_count, kFrames - 10);
    for (const int frame : {57, 58, 0, 89, 3}) {
        ASSERT_TRUE((*source)->seek(frame).ok());
        const auto set = (*source)->next();
        ASSERT_TRUE(set.ok()) << set.status();
        EXPECT_EQ(set->recorded_frame, frame);
        EXPECT_EQ(set->capture_time_ns, static_cast<std::int64_t>(frame * 1e9 / kFps));
        for (std::size_t c = 0; c < 3; ++c)
            EXPECT_EQ(number_in(set->images[c]), frame + 7 - std::get<2>(begun[c])) << c;
    }
    EXPECT_FALSE((*source)->seek(kFrames - 10).ok());
}

TEST_F(ReplaySourceTest, SlowReaderSkipsFrameSets) {
    const auto source = open({.speed = 1});
    ASSERT_TRUE(source);
    int taken = 0;
    for (std::int64_t last = -1; last < kFrames - 1; ++taken) {
        const auto set = source->next();
        ASSERT_TRUE(set.ok());
        EXPECT_EQ(set->sequence, static_cast<std::uint64_t>(*set->recorded_frame));
        EXPECT_FALSE(set->after_discontinuity);
        last = *set->recorded_frame;
        std::this_thread::sleep_for(std::chrono::milliseconds(25));  // five frames long
    }
    EXPECT_LT(taken, kFrames / 2);
}

TEST_F(ReplaySourceTest, RejectsInvalidRequests) {
    const auto source = open({.paused = true});
    ASSERT_TRUE(source);
    for (const std::int64_t frame : {std::int64_t{-1}, std::int64_t{kFrames}, std::int64_t{1} << 62})
        EXPECT_TRUE(absl::IsOutOfRange(source->seek(frame)));
    EXPECT_THAT(std::string(source->seek(kFrames).message()), HasSubstr("0 to 99"));
    for (const double speed : {0.0, -1.0, 1000.0, std::nan("")})
        EXPECT_TRUE(absl::IsOutOfRange(source->set_speed(speed)));
    EXPECT_TRUE(
        absl::IsInvalidArgument(ReplaySource::open(shared_->path() / "session.toml", {.speed = 0}).status()));
    EXPECT_TRUE(absl::IsNotFound(ReplaySource::open(shared_->path() / "none.toml").status()));
    expect_shows(source->next(), 0);
}

}  // namespace
}  // namespace kinevox
