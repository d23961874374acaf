// The video of a session with its skeleton: lost frame sets.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "common/session_file.h"
#include "server/cameras/image_reader.h"
#include "server/recording/recording_export.h"
#include "tests/support/small_session.h"

namespace kinevox {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// A line of joints in front of the cameras, at another height in each frame; NaN where lost.
Trial trial_with_lost_frame() {
    Trial trial;
    trial.name = "small";
    trial.rate_hz = 20;
    trial.session_frames = {0, -1, 2, 3};
    for (int n = 0; n < 4; ++n) {
        trial.frames.push_back(n);
        trial.time_s.push_back(n / trial.rate_hz);
        auto& joints = trial.joints.emplace_back();
        for (std::size_t j = 0; j < joints.size(); ++j)
            joints[j] =
                n == 1 ? Vec3{kNaN, kNaN, kNaN} : Vec3{0, 0.05 * static_cast<double>(j) - 0.5, 0.6 + 0.2 * n};
    }
    return trial;
}

// Mean absolute difference of two images, grey levels.
double difference(const Image& a, const Image& b) {
    const std::size_t bytes = static_cast<std::size_t>(a.width) * a.height * a.channels;
    double sum = 0;
    for (std::size_t i = 0; i < bytes; ++i) sum += std::abs(int{a.data[i]} - int{b.data[i]});
    return sum / static_cast<double>(bytes);
}

TEST(OverlayVideo, RepeatsImageAndSkeletonOverALostFrame) {
    const testing::TemporaryFolder folder;
    const auto session = read_session(testing::write_small_session(folder.path() / "session"));
    ASSERT_TRUE(session.ok()) << session.status();
    const auto cameras = read_session_cameras(*session);
    ASSERT_TRUE(cameras.ok()) << cameras.status();
    const std::filesystem::path video = folder.path() / "video.mp4";
    const std::atomic<bool> stop = false;
    const Trial trial = trial_with_lost_frame();
    const absl::Status written =
        write_overlay_video(*session, {&trial, 1}, {.camera = "cam1"}, video, {stop});
    ASSERT_TRUE(written.ok()) << written;

    const auto reader = open_images(video, cameras->front());
    ASSERT_TRUE(reader.ok()) << reader.status();
    std::vector<Image> images;
    for (int n = 0; n < 4; ++n) {
        auto image = (*reader)->next();
        ASSERT_TRUE(image.ok()) << image.status();
        images.push_back(*std::move(image));
    }
    const double repeated = difference(images[0], images[1]), moved = difference(images[1], images[2]);
    EXPECT_LT(repeated, 1.5);  // H.264
    EXPECT_GT(moved, 2 * repeated);
}

}  // namespace
}  // namespace kinevox
