#include "server/cameras/session_source.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <thread>

#include "common/calibration_file.h"
#include "common/stopwatch.h"
#include "server/cameras/image_pool.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/test_data.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr int kFilmWidth = 64, kFilmHeight = 48, kFilmFrames = 12;

// Frame n of camera c is recognised by its grey level.
int grey_of(int camera, int frame) {
    return 20 + 60 * camera + 4 * frame;
}
cv::Mat frame_image(int camera, int frame, cv::Size size = {kFilmWidth, kFilmHeight}) {
    return cv::Mat(size, CV_8UC3, cv::Scalar::all(grey_of(camera, frame)));
}

void write_video(const fs::path& file, int camera, int frames, cv::Size size = {kFilmWidth, kFilmHeight}) {
    cv::VideoWriter writer(file.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 30,
                           size);
    ASSERT_TRUE(writer.isOpened());
    for (int n = 0; n < frames; ++n) writer.write(frame_image(camera, n, size));
}

void write_folder(const fs::path& folder, int camera, int frames) {
    fs::create_directories(folder);
    for (int n = 0; n < frames; ++n)  // no leading zeros: 10 must come behind 9
        cv::imwrite((folder / fmt::format("frame{}.png", n)).string(), frame_image(camera, n));
}

void shorten_file(const fs::path& file, double part) {
    fs::resize_file(file, static_cast<std::uintmax_t>(part * static_cast<double>(fs::file_size(file))));
}

// Two cameras: `left` a video, `right` a folder; both with a image of the empty scene.
class SessionOnDisk : public ::testing::Test {
  protected:
    void SetUp() override {
        silence_video_libraries();
        std::vector<Camera> cameras(2);
        for (int c = 0; c < 2; ++c) {
            cameras[c].name = c == 0 ? "left" : "right";
            cameras[c].width = kFilmWidth, cameras[c].height = kFilmHeight;
            cameras[c].fx = cameras[c].fy = 60, cameras[c].cx = 31.5, cameras[c].cy = 23.5;
            cv::imwrite((folder_ / fmt::format("empty{}.png", c)).string(), frame_image(c, 0));
        }
        ASSERT_TRUE(write_calibration_toml(cameras, folder_ / "calibration.toml").ok());
        write_video(folder_ / "left.avi", 0, kFilmFrames);
        write_folder(folder_ / "right", 1, kFilmFrames);
        folder_.write("session.toml",
                      "name = \"made\"\nfps = 50.0\ncalibration = \"calibration.toml\"\n"
                      "[[camera]]\nname = \"left\"\nvideo = \"left.avi\"\nbackground = \"empty0.png\"\n"
                      "[[camera]]\nname = \"right\"\nvideo = \"right\"\nbackground = \"empty1.png\"\n");
    }

    absl::StatusOr<std::unique_ptr<FrameSource>> open(const SessionSourceOptions& options = {}) {
        return open_session_source(folder_ / "session.toml", options);
    }

    // Opens and reads to the end: the first error, or OK behind the last frame set.
    absl::Status read_all() {
        auto source = open();
        if (!source.ok()) return source.status();
        if (auto background = (*source)->background(); !background.ok()) return background.status();
        for (;;) {
            auto set = (*source)->next();
            if (absl::IsOutOfRange(set.status())) return absl::OkStatus();
            if (!set.ok()) return set.status();
        }
    }

    testing::TemporaryFolder folder_;
};

TEST_F(SessionOnDisk, DeliversAllFrameSetsInOrder) {
    for (const bool bursts : {false, true})
        for (const int ahead : {1, 3, 0}) {
            auto source = open({.frames_ahead = ahead, .decode_in_bursts = bursts});
            ASSERT_TRUE(source.ok()) << source.status();
            EXPECT_EQ((*source)->frame_count(), kFilmFrames);
            EXPECT_EQ((*source)->fps(), 50);
            for (int n = 0; n < kFilmFrames; ++n) {
                auto set = (*source)->next();
                ASSERT_TRUE(set.ok()) << set.status();
                EXPECT_EQ(set->sequence, static_cast<std::uint64_t>(n));
                EXPECT_EQ(set->capture_time_ns, n * 20'000'000);
                ASSERT_EQ(set->images.size(), 2u);
                EXPECT_NEAR(set->images[0].data[0], grey_of(0, n), 2) << n;  // motion JPEG
                EXPECT_EQ(set->images[1].data[3 * kFilmWidth * kFilmHeight - 1], grey_of(1, n)) << n;
            }
            EXPECT_TRUE(absl::IsOutOfRange((*source)->next().status()));
            EXPECT_TRUE(absl::IsOutOfRange((*source)->next().status())) << "and stays so";
        }
}

TEST_F(SessionOnDisk, ReadsBackground) {
    auto source = open();
    ASSERT_TRUE(source.ok());
    const auto background = (*source)->background();
    ASSERT_TRUE(background.ok()) << background.status();
    ASSERT_EQ(background->size(), 2u);
    ASSERT_EQ((*background)[1].size(), 1u);
    EXPECT_EQ((*background)[1][0].data[0], grey_of(1, 0));
}

TEST_F(SessionOnDisk, LoopRestarts) {
    auto source = open({.loop = true});
    ASSERT_TRUE(source.ok());
    EXPECT_EQ((*source)->frame_count(), -1);
    for (int n = 0; n < 3 * kFilmFrames; ++n) {
        auto set = (*source)->next();
        ASSERT_TRUE(set.ok()) << set.status();
        EXPECT_EQ(set->sequence, static_cast<std::uint64_t>(n));
        EXPECT_EQ(set->images[1].data[0], grey_of(1, n % kFilmFrames));
    }
}

TEST_F(SessionOnDisk, RealTimePacingSkipsLateSets) {
    auto source = open({.pacing = Pacing::kRealTime});
    ASSERT_TRUE(source.ok());
    const Stopwatch playing;
    std::vector<std::uint64_t> sequences;
    for (;;) {
        auto set = (*source)->next();
        if (!set.ok()) break;
        sequences.push_back(set->sequence);
        if (set->sequence == 3)
            std::this_thread::sleep_for(std::chrono::milliseconds(75));  // three frames and more
    }
    const double seconds = playing.seconds();
    EXPECT_GE(seconds, (kFilmFrames - 1) / 50.0 - 0.001);
    EXPECT_LT(sequences.size(), static_cast<std::size_t>(kFilmFrames)) << "late frame sets are skipped";
    EXPECT_TRUE(std::is_sorted(sequences.begin(), sequences.end()));
}

TEST_F(SessionOnDisk, SlowDecodingStillDeliversSets) {
    // Images of noise, each of which takes many times the half millisecond that lies between two of them.
    const cv::Size size(1280, 960);
    std::vector<Camera> cameras(1);
    cameras[0].name = "left";
    cameras[0].width = size.width, cameras[0].height = size.height;
    cameras[0].fx = cameras[0].fy = 1000, cameras[0].cx = 639.5, cameras[0].cy = 479.5;
    ASSERT_TRUE(write_calibration_toml(cameras, folder_ / "large.toml").ok());
    fs::create_directories(folder_ / "noise");
    cv::Mat noise(size, CV_8UC3);
    for (int n = 0; n < 3; ++n) {
        cv::randu(noise, 0, 255);
        cv::imwrite((folder_ / fmt::format("noise/{}.png", n)).string(), noise);
    }
    folder_.write("session.toml",
                  "name = \"fast\"\nfps = 2000.0\ncalibration = \"large.toml\"\n"
                  "[[camera]]\nname = \"left\"\nvideo = \"noise\"\n");
    auto source = open({.pacing = Pacing::kRealTime, .loop = true});
    ASSERT_TRUE(source.ok()) << source.status();
    std::jthread patience([&](const std::stop_token& stop) {
        for (int n = 0; n < 200 && !stop.stop_requested(); ++n)
            std::this_thread::sleep_for(std::chrono::milliseconds(50));
        (*source)->stop();
    });
    std::int64_t last_ns = 0;
    for (int n = 0; n < 20; ++n) {
        const auto set = (*source)->next();
        ASSERT_TRUE(set.ok()) << "none came within ten seconds: " << set.status();
        EXPECT_GE(set->capture_time_ns, last_ns);
        last_ns = set->capture_time_ns;
    }
    patience.request_stop();
}

TEST_F(SessionOnDisk, StopsFromAnotherThread) {
    auto source = open({.pacing = Pacing::kRealTime, .loop = true});
    ASSERT_TRUE(source.ok());
    std::jthread stopper([&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(60));
        (*source)->stop();
    });
    for (;;) {
        const auto set = (*source)->next();
        if (set.ok()) continue;
        EXPECT_TRUE(absl::IsCancelled(set.status())) << set.status();
        break;
    }
    EXPECT_TRUE(absl::IsCancelled((*source)->next().status()));
}

// The same two cameras, begun one after the other: left first, right by 3.4 frames later, for as long as it
// could.
class LateCamera : public SessionOnDisk {
  protected:
    void SetUp() override {
        SessionOnDisk::SetUp();
        fs::remove_all(folder_ / "right");
        write_folder(folder_ / "right", 1, kFilmFrames + 3);
        write_offset("0.068");
    }
    void write_offset(const std::string& right) {
        folder_.write(
            "session.toml",
            "name = \"made\"\nfps = 50.0\ncalibration = \"calibration.toml\"\n"
            "[[camera]]\nname = \"left\"\nvideo = \"left.avi\"\nbackground = \"empty0.png\"\n"
            "[[camera]]\nname = \"right\"\nvideo = \"right\"\nbackground = \"empty1.png\"\noffset_s = " +
                right + "\n");
    }
    static void expect_images(const FrameSet& set, int left, int right) {
        EXPECT_NEAR(set.images[0].data[0], grey_of(0, left), 2);  // motion JPEG
        EXPECT_EQ(set.images[1].data[0], grey_of(1, right));
    }
};

TEST_F(LateCamera, JoinsImagesOfSameTime) {
    for (const auto& [offset, left, right] : {std::tuple{"0.068", 3, 0}, {"-0.068", 0, 3}, {"0.075", 4, 0}}) {
        write_offset(offset);
        auto source = open();
        ASSERT_TRUE(source.ok()) << source.status();
        const int length = std::min(kFilmFrames - left, kFilmFrames + 3 - right);
        EXPECT_EQ((*source)->frame_count(), length);
        for (int n = 0; n < length; ++n) {
            auto set = (*source)->next();
            ASSERT_TRUE(set.ok()) << set.status();
            EXPECT_EQ(set->sequence, static_cast<std::uint64_t>(n));
            EXPECT_EQ(set->capture_time_ns, n * 20'000'000);
            expect_images(*set, left + n, right + n);
        }
        EXPECT_TRUE(absl::IsOutOfRange((*source)->next().status()));
        const auto background = (*source)->background();
        ASSERT_TRUE(background.ok());
        EXPECT_EQ((*background)[1][0].data[0], grey_of(1, 0)) << "the empty scene is not shifted";
    }
}

TEST_F(LateCamera, LoopsWithOtherCamera) {
    auto source = open({.loop = true});
    ASSERT_TRUE(source.ok()) << source.status();
    for (int n = 0; n < 3 * (kFilmFrames - 3); ++n) {
        auto set = (*source)->next();
        ASSERT_TRUE(set.ok()) << set.status();
        EXPECT_EQ(set->sequence, static_cast<std::uint64_t>(n));
        expect_images(*set, 3 + n % (kFilmFrames - 3), n % (kFilmFrames - 3));
    }
}

// Matroska does not store the exact number of frames; it is counted.
TEST_F(LateCamera, EndsWithFirstVideo) {
    write_video(folder_ / "left.mkv", 0, kFilmFrames);
    std::string text;
    {
        std::ifstream stream(folder_ / "session.toml");
        text.assign(std::istreambuf_iterator<char>(stream), {});
    }
    folder_.write("session.toml", text.replace(text.find("left.avi"), 8, "left.mkv"));
    for (const bool loop : {false, true}) {
        auto source = open({.loop = loop});
        ASSERT_TRUE(source.ok()) << source.status();
        for (int n = 0; n < kFilmFrames - 3; ++n) {
            auto set = (*source)->next();
            ASSERT_TRUE(set.ok()) << set.status();
            expect_images(*set, 3 + n, n);
        }
        const auto after = (*source)->next();
        EXPECT_EQ(absl::IsOutOfRange(after.status()), !loop) << after.status();
        if (loop) expect_images(*after, 3, 0);
    }
}

TEST_F(LateCamera, RejectsCamerasWithoutCommonTime) {
    write_offset("0.25");
    const auto source = open();
    ASSERT_FALSE(source.ok());
    EXPECT_THAT(std::string(source.status().message()),
                AllOf(HasSubstr("camera right begins when camera left has ended"), HasSubstr("offset_s")));
}

struct BadInput {
    std::string name;
    std::function<void(const testing::TemporaryFolder&)> spoil;
    std::vector<std::string> message_has;  // all of them
};

class BadSession : public SessionOnDisk, public ::testing::WithParamInterface<BadInput> {};

TEST_P(BadSession, ErrorNamesCameraFileAndNumbers) {
    GetParam().spoil(folder_);
    const absl::Status status = read_all();
    ASSERT_FALSE(status.ok());
    const std::string message(status.message());
    for (const std::string& part : GetParam().message_has) EXPECT_THAT(message, HasSubstr(part));
    EXPECT_THAT(message, Not(HasSubstr("\n")));
}

INSTANTIATE_TEST_SUITE_P(
    All, BadSession,
    ::testing::Values(
        BadInput{"missing_video", [](const auto& f) { fs::remove(f / "left.avi"); }, {"left.avi", "left"}},
        BadInput{"missing_folder", [](const auto& f) { fs::remove_all(f / "right"); }, {"right"}},
        BadInput{"empty_folder",
                 [](const auto& f) {
                     fs::remove_all(f / "right");
                     fs::create_directory(f / "right");
                 },
                 {"camera right", "contains no images"}},
        BadInput{"no_video",
                 [](const auto& f) { f.write("left.avi", "this is a text, not a video"); },
                 {"camera left", "left.avi", "cannot be read as a video"}},
        BadInput{"empty_file", [](const auto& f) { f.write("left.avi", ""); }, {"camera left", "left.avi"}},
        BadInput{"shorter_video",
                 [](const auto& f) { write_video(f / "left.avi", 0, 7); },
                 {"camera left", "left.avi", "7 frames", "camera right has 12", "trim all to 7"}},
        BadInput{"shorter_folder",
                 [](const auto& f) { fs::remove(f / "right" / "frame11.png"); },
                 {"camera right", "11 frames", "camera left has 12"}},
        BadInput{"cut_off_video",
                 [](const auto& f) { shorten_file(f / "left.avi", 0.85); },
                 {"camera left", "left.avi", "of 12 frames", "damaged or truncated"}},
        BadInput{"wrong_video_size",
                 [](const auto& f) {
                     write_video(f / "left.avi", 0, kFilmFrames, {80, 48});
                 },
                 {"camera left", "left.avi", "80 x 48", "64 x 48"}},
        BadInput{"wrong_image_size",
                 [](const auto& f) {
                     cv::imwrite((f / "right" / "frame5.png").string(), frame_image(1, 5, {64, 40}));
                 },
                 {"camera right", "frame5.png", "64 x 40", "64 x 48"}},
        BadInput{"damaged_image",
                 [](const auto& f) { f.write("right/frame5.png", "no image"); },
                 {"camera right", "frame5.png", "image 6 of 12"}},
        BadInput{"wrong_background_size",
                 [](const auto& f) {
                     cv::imwrite((f / "empty1.png").string(), frame_image(1, 0, {32, 24}));
                 },
                 {"camera right", "empty1.png", "32 x 24"}},
        BadInput{"damaged_background",
                 [](const auto& f) { f.write("empty0.png", "?"); },
                 {"camera left", "empty0.png"}},
        BadInput{"impossible_background_size",
                 [](const auto& f) { f.write("empty0.png", "P6\n2000000 2000000\n255\nabc"); },
                 {"camera left", "empty0.png", "cannot be decoded"}},
        BadInput{"missing_background", [](const auto& f) { fs::remove(f / "empty0.png"); }, {"empty0.png"}}),
    [](const auto& info) { return info.param.name; });

// An index at the file's start promises frames that a cut-off file no longer holds: what a broken copy looks
// like.
TEST(SessionSource, ErrorNamesFrameOfTruncation) {
    KINEVOX_REQUIRE_DATA(walk, "studio/walk");
    silence_video_libraries();
    const testing::TemporaryFolder folder;
    fs::copy(walk, folder.path(), fs::copy_options::recursive);
    fs::permissions(folder / "cam3.mp4", fs::perms::owner_write, fs::perm_options::add);
    shorten_file(folder / "cam3.mp4", 0.5);
    absl::Status status;
    auto source = open_session_source(folder / "session.toml");
    if (!source.ok()) status = source.status();
    while (status.ok()) status = (*source)->next().status();
    EXPECT_FALSE(absl::IsOutOfRange(status)) << "the end of the other videos must not hide it";
    EXPECT_THAT(std::string(status.message()), AllOf(HasSubstr("camera cam3"), HasSubstr("cam3.mp4")));
}

TEST(ImagePool, ReusesReleasedBuffer) {
    ImagePool pool(1000);
    auto a = pool.take();
    const std::uint8_t* address = a.get();
    auto b = pool.take();
    EXPECT_NE(b.get(), address);
    a.reset();
    EXPECT_EQ(pool.take().get(), address);
}

TEST(ImagePool, BuffersOutlivePool) {
    std::shared_ptr<std::uint8_t[]> buffer;
    {
        ImagePool pool(16);
        buffer = pool.take();
    }
    buffer[15] = 7;
    EXPECT_EQ(buffer[15], 7);
}

}  // namespace
}  // namespace kinevox
