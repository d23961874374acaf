// The live judgement on images of one level: it begins, reports and ends.
#include "server/quality/live_quality.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <thread>

namespace kinevox::quality {
namespace {

using std::chrono::steady_clock;

Image grey_image(int width, int height, std::uint8_t level) {
    const std::size_t bytes = 3u * width * height;
    std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[bytes]);
    for (std::size_t k = 0; k < bytes; ++k) data[k] = static_cast<std::uint8_t>(level + k * 7919 % 5);
    return {width, height, 3, std::move(data)};
}

Camera camera_at(const char* name, double x) {
    Camera camera;
    camera.name = name;
    camera.width = 64, camera.height = 48;
    camera.fx = camera.fy = 60, camera.cx = 31.5, camera.cy = 23.5;
    camera.camera_from_world.rotation = rotation_from_rodrigues({1.2, 0, 0});
    camera.camera_from_world.translation = {x, 0, 3};
    return camera;
}

FrameResult result_at(std::uint64_t sequence, std::uint8_t level) {
    FrameResult result;
    result.sequence = sequence;
    result.capture_time_ns = static_cast<std::int64_t>(sequence) * 1'000'000'000;
    result.frame_set.images.assign(2, grey_image(64, 48, level));
    return result;
}

std::optional<QualityReport> report_of(LiveQuality& quality, std::uint8_t level) {
    const auto deadline = steady_clock::now() + std::chrono::seconds(30);
    for (std::uint64_t n = 1; steady_clock::now() < deadline && !quality.report(); ++n) {
        quality.observe(result_at(n, level), nullptr);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return quality.report();
}

TEST(LiveQuality, JudgesTheLatestSamples) {
    LiveQuality quality({.samples = 4, .judge_after = 4});
    EXPECT_FALSE(quality.report());
    quality.observe(result_at(0, 100), nullptr);  // no background yet
    using Background = std::vector<std::vector<Image>>;
    quality.set_background(
        {camera_at("left", -1), camera_at("right", 1)},
        std::make_shared<const Background>(2, std::vector<Image>(6, grey_image(64, 48, 100))));
    const auto report = report_of(quality, 200);  // foreground everywhere, and no subject
    ASSERT_TRUE(report);
    EXPECT_EQ(report->measurements.frame_sets, 4);
    EXPECT_TRUE(
        std::ranges::any_of(report->causes, [](const Cause& cause) { return cause.cause == "no_subject"; }));
    quality.set_cameras({camera_at("left", -1), camera_at("right", 1)});
    EXPECT_FALSE(quality.report()) << "of the former cameras";
}

TEST(LiveQuality, EndsWithoutAnyResult) {
    const LiveQuality quality;
    EXPECT_FALSE(quality.report());
}

}  // namespace
}  // namespace kinevox::quality
