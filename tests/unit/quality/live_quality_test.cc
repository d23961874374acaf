// The live judgement on drawn images: it begins, reports and ends.
#include "server/quality/live_quality.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <thread>

namespace kinevox::quality {
namespace {

using std::chrono::steady_clock;

constexpr int kWidth = 64, kHeight = 48;

// A grey wall; `occupied`: with a blue box before it.
Image image_of(bool occupied, int scale = 1) {
    const int width = scale * kWidth, height = scale * kHeight;
    std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[3 * width * height]);
    std::size_t k = 0;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            for (int channel = 0; channel < 3; ++channel, ++k) {
                const bool box =
                    occupied && x >= 20 * scale && x < 44 * scale && y >= 8 * scale && y < 40 * scale;
                const int level = !box ? 100 : channel == 0 ? 230 : 20;
                data[k] = static_cast<std::uint8_t>(level + k * 7919 % 5);
            }
    return {width, height, 3, std::move(data)};
}

Camera camera_at(const char* name, double x) {
    Camera camera;
    camera.name = name;
    camera.width = kWidth, camera.height = kHeight;
    camera.fx = camera.fy = 60, camera.cx = 31.5, camera.cy = 23.5;
    camera.camera_from_world.rotation = rotation_from_rodrigues({1.2, 0, 0});
    camera.camera_from_world.translation = {x, 0, 3};
    return camera;
}

const BodyShape* no_body(std::uint32_t) {
    return nullptr;
}

FrameResult result_at(std::uint64_t sequence) {
    FrameResult result;
    result.sequence = sequence;
    result.capture_time_ns = static_cast<std::int64_t>(sequence) * 1'000'000'000;
    result.frame_set.images.assign(2, image_of(true));
    return result;
}

std::shared_ptr<const QualityReport> report_of(LiveQuality& quality) {
    const auto deadline = steady_clock::now() + std::chrono::seconds(30);
    for (std::uint64_t n = 1; steady_clock::now() < deadline && !quality.report(); ++n) {
        quality.observe(result_at(n), no_body);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return quality.report();
}

TEST(LiveQuality, JudgesTheLatestSamples) {
    LiveQuality quality({.samples = 4, .judge_after = 4});
    EXPECT_FALSE(quality.report());
    quality.observe(result_at(0), no_body);  // no background yet
    using Background = std::vector<std::vector<Image>>;
    quality.set_background({camera_at("left", -1), camera_at("right", 1)},
                           std::make_shared<const Background>(2, std::vector<Image>(6, image_of(false))));
    const auto report = report_of(quality);  // foreground, but no subject
    ASSERT_TRUE(report);
    EXPECT_EQ(report->measurements.frame_sets, 4);
    EXPECT_TRUE(
        std::ranges::any_of(report->causes, [](const Cause& cause) { return cause.cause == "no_subject"; }));
    quality.set_cameras({camera_at("left", -1), camera_at("right", 1)});
    EXPECT_FALSE(quality.report()) << "of the former cameras";
}

TEST(LiveQuality, ObservesWithoutWaitingForTheBackgroundToBeLearned) {
    using Background = std::vector<std::vector<Image>>;
    constexpr int kScale = 10;
    const Background background(2, std::vector<Image>(60, image_of(false, kScale)));
    std::vector<Camera> cameras{camera_at("left", -1), camera_at("right", 1)};
    for (Camera& camera : cameras) {
        camera.width *= kScale, camera.height *= kScale;
        camera.fx *= kScale, camera.fy *= kScale, camera.cx *= kScale, camera.cy *= kScale;
    }
    const auto begun = steady_clock::now();
    const Observer learned(cameras, background, {});
    const auto learning = steady_clock::now() - begun;
    LiveQuality quality({.samples = 4, .judge_after = 4});
    quality.set_background(cameras, std::make_shared<const Background>(background));
    FrameResult result = result_at(1);
    result.frame_set.images.assign(2, image_of(true, kScale));
    quality.observe(result, no_body);
    std::this_thread::sleep_for(learning / 8);  // the thread has begun to learn
    const auto observed = steady_clock::now();
    result.capture_time_ns *= 2;
    quality.observe(result, no_body);
    EXPECT_LT(steady_clock::now() - observed, learning / 4);
}

TEST(LiveQuality, JudgesTheWorstOfSeveralSubjects) {
    LiveQuality quality({.samples = 4, .judge_after = 4, .several_subjects = true});
    using Background = std::vector<std::vector<Image>>;
    quality.set_background({camera_at("left", -1), camera_at("right", 1)},
                           std::make_shared<const Background>(2, std::vector<Image>(6, image_of(false))));
    const BodyShape small = default_body_shape(1.6), tall = default_body_shape(1.9);
    const BodyOf body_of = [&](std::uint32_t id) { return id == 9 ? &tall : &small; };
    BodyPose sure;
    for (JointEstimate& joint : sure.joints) joint = {.in_world = {0, 0, 1}, .std_m = 0.01};
    BodyPose unsure = sure;
    for (std::size_t j = 0; j < unsure.joints.size(); j += 2) unsure.joints[j].withheld_reason = "hidden";
    const auto deadline = steady_clock::now() + std::chrono::seconds(30);
    for (std::uint64_t n = 1; steady_clock::now() < deadline && !quality.report(); ++n) {
        FrameResult result = result_at(n);
        result.subjects.resize(2);
        result.subjects[0].track.subject_id = 2;
        result.subjects[0].pose = std::make_shared<const BodyPose>(sure);
        result.subjects[1].track.subject_id = 9;
        result.subjects[1].pose = std::make_shared<const BodyPose>(unsure);
        quality.observe(result, body_of);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    const auto report = quality.report();
    ASSERT_TRUE(report);
    const Measurements& seen = report->measurements;
    EXPECT_EQ(seen.followed_subjects, 2);
    EXPECT_EQ(seen.subject_id, 9u);
    EXPECT_DOUBLE_EQ(*seen.body.stature_m, 1.9);
    EXPECT_GT(seen.pose.withheld_fraction, 0.4);
    EXPECT_FALSE(seen.pose.posed_iou) << "the silhouettes are of two people";
}

TEST(LiveQuality, EndsWithoutAnyResult) {
    const LiveQuality quality;
    EXPECT_FALSE(quality.report());
}

}  // namespace
}  // namespace kinevox::quality
