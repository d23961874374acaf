#include "client/lib/image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <random>

#include "tests/support/person_volume.h"
#include "tests/support/temporary_folder.h"

namespace kinevox::client {
namespace {

std::vector<std::uint8_t> jpeg_of(const cv::Mat& image) {
    std::vector<std::uint8_t> bytes;
    cv::imencode(".jpg", image, bytes, {cv::IMWRITE_JPEG_QUALITY, 95});
    return bytes;
}

TEST(DecodeJpeg, ReadsColourAndGrey) {
    const auto colour = decode_jpeg(jpeg_of(cv::Mat(20, 30, CV_8UC3, cv::Scalar(10, 120, 240))));  // B G R
    ASSERT_TRUE(colour.ok()) << colour.status();
    EXPECT_EQ(colour->width, 30);
    EXPECT_EQ(colour->height, 20);
    ASSERT_EQ(colour->channels, 3);
    EXPECT_NEAR(colour->data[0], 240, 4);  // R first
    EXPECT_NEAR(colour->data[2], 10, 4);
    const auto grey = decode_jpeg(jpeg_of(cv::Mat(8, 9, CV_8UC1, cv::Scalar(77))));
    ASSERT_TRUE(grey.ok());
    EXPECT_EQ(grey->channels, 1);
    EXPECT_EQ(grey->data.size(), 72u);
}

TEST(DecodeJpeg, RefusesIncompleteJpeg) {
    std::mt19937 random(3);
    cv::Mat noise(32, 32, CV_8UC3);
    cv::randu(noise, 0, 255);
    const auto whole = jpeg_of(noise);
    EXPECT_FALSE(decode_jpeg({}).ok());
    for (const std::size_t size : {std::size_t{1}, std::size_t{20}, whole.size() / 2})
        EXPECT_EQ(decode_jpeg({whole.data(), size}).status().code(), absl::StatusCode::kInvalidArgument)
            << size;
    for (int i = 0; i < 200; ++i) {  // any damage yields an image or an error, never more
        auto damaged = whole;
        for (int k = 0; k < 5; ++k) damaged[random() % damaged.size()] = static_cast<std::uint8_t>(random());
        decode_jpeg(damaged).status().IgnoreError();
    }
}

TEST(WritePng, IsReadBackByOpenCv) {
    const testing::TemporaryFolder folder;
    const auto file = folder / "image.png";
    Image image{3, 2, 3, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18}};
    ASSERT_TRUE(write_png(image, file).ok());
    const cv::Mat read = cv::imread(file.string());
    ASSERT_EQ(read.cols, 3);
    EXPECT_EQ(read.at<cv::Vec3b>(1, 2), cv::Vec3b(18, 17, 16));
}

// The rendered body must be where the camera model projects the volume.
TEST(RenderVolume, DrawsVolumeWhereCameraProjectsIt) {
    const Volume person = testing::person_volume(0.02);
    const Camera camera = oblique_camera({&person, 1}, {4, 1, 1}, 0.3, 0.2, 200, 300);
    RenderOptions options;
    options.background = {0, 255, 0};
    options.floor_grid = false;
    const Image image = render_volume(person, camera, options);
    const auto is_body = [&](int x, int y) {
        const auto i = static_cast<std::size_t>(3 * (y * image.width + x));
        return !(image.data[i] == 0 && image.data[i + 1] == 255 && image.data[i + 2] == 0);
    };
    int body = 0, holes = 0;
    for (const VoxelIndex& v : surface_voxels(person)) {
        const auto pixel = camera.project(testing::voxel_centre_in_world(person.grid, v));
        ASSERT_TRUE(pixel);
        const int x = static_cast<int>(std::lround(pixel->x)), y = static_cast<int>(std::lround(pixel->y));
        ASSERT_TRUE(x >= 0 && y >= 0 && x < image.width && y < image.height)
            << "the whole person is in the image";
        holes += !is_body(x, y);
    }
    EXPECT_EQ(holes, 0);
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x) body += is_body(x, y);
    EXPECT_GT(body, 200 * 300 / 20);
    EXPECT_LT(body, 200 * 300 / 2);
}

TEST(RenderVolume, ShowsTheNearestOfSeveral) {
    std::vector<Volume> people(2, testing::person_volume(0.03));
    people[0].colours.assign(surface_voxels(people[0]).size(), {250, 0, 0});
    people[1].colours.assign(surface_voxels(people[1]).size(), {0, 0, 250});
    const Vec3 towards{4, 0, 1};
    const auto count = [&](const Camera& camera, std::size_t channel) {
        const Image image = render_volumes(people, camera);
        int pixels = 0;
        for (std::size_t i = 0; i < image.data.size(); i += 3)
            pixels += image.data[i + channel] > 60 && image.data[i + 2 - channel] < 40;
        return pixels;
    };
    people[1].grid.origin_in_world.y += 1.2;  // side by side
    Camera camera = oblique_camera(people, towards, 0, 0.1, 300, 300);
    const int red = count(camera, 0), blue = count(camera, 2);
    EXPECT_GT(red, 1000);
    EXPECT_NEAR(blue, red, 0.2 * red);
    people[1].grid.origin_in_world.y -= 1.2;
    people[1].grid.origin_in_world.x -= 0.8;  // behind
    EXPECT_LT(count(camera, 2), 0.4 * blue);
    EXPECT_NEAR(count(camera, 0), red, 0.1 * red);
}

TEST(RenderVolume, CroppedScaledCameraMatchesCroppedScaledImage) {
    const Volume person = testing::person_volume(0.03);
    const Camera camera = oblique_camera({&person, 1}, {4, 1, 1}, 0.3, 0.2, 320, 240);
    const Window window = window_around({&person, 1}, camera);
    EXPECT_LE(window.x + window.width, camera.width);
    EXPECT_EQ(render_volume(person, cropped(camera, window)).data,
              cropped(render_volume(person, camera), window).data);
    const Camera half = scaled(camera, 0.5);
    const Vec3 point{0.1, 0.2, 1.0};
    EXPECT_NEAR(half.project(point)->x, (camera.project(point)->x + 0.5) / 2 - 0.5, 1e-9);
}

}  // namespace
}  // namespace kinevox::client
