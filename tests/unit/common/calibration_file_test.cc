#include "common/calibration_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "tests/support/temporary_folder.h"
#include "tests/support/test_data.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;

void expect_cameras_near(const std::vector<Camera>& a, const std::vector<Camera>& b, double tolerance_px,
                         double tolerance) {
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) {
        SCOPED_TRACE(a[i].name);
        EXPECT_EQ(a[i].name, b[i].name);
        EXPECT_EQ(a[i].width, b[i].width);
        EXPECT_EQ(a[i].height, b[i].height);
        EXPECT_NEAR(a[i].fx, b[i].fx, tolerance_px);
        EXPECT_NEAR(a[i].fy, b[i].fy, tolerance_px);
        EXPECT_NEAR(a[i].cx, b[i].cx, tolerance_px);
        EXPECT_NEAR(a[i].cy, b[i].cy, tolerance_px);
        EXPECT_NEAR(a[i].k1, b[i].k1, tolerance);
        EXPECT_NEAR(a[i].k2, b[i].k2, tolerance);
        EXPECT_NEAR(a[i].p1, b[i].p1, tolerance);
        EXPECT_NEAR(a[i].p2, b[i].p2, tolerance);
        EXPECT_NEAR(a[i].k3, b[i].k3, tolerance);
        for (int e = 0; e < 9; ++e)
            EXPECT_NEAR(a[i].camera_from_world.rotation.m[e], b[i].camera_from_world.rotation.m[e],
                        tolerance);
        EXPECT_NEAR(norm(a[i].camera_from_world.translation - b[i].camera_from_world.translation), 0,
                    tolerance);
    }
}

std::vector<Camera> two_cameras() {
    Camera a;
    a.name = "left";
    a.width = 640, a.height = 480;
    a.fx = 612.345678901234567, a.fy = 1.0 / 3 * 1800, a.cx = 319.5, a.cy = 239.4999999;
    a.k1 = -0.1, a.k2 = 1e-17, a.p1 = 3e-5, a.p2 = -2.0 / 7, a.k3 = 0.01;
    a.camera_from_world = {rotation_from_rodrigues({1.2, -0.7, 2.1}), {0.1, -2.0 / 3, 4.5}};
    Camera b = a;
    b.name = "right of the door";
    b.camera_from_world = {rotation_from_rodrigues({3.1, 0.2, 0.1}), {0, 0, 1e-9}};
    return {a, b};
}

TEST(CalibrationToml, RoundTrips) {
    const testing::TemporaryFolder folder;
    const std::vector<Camera> written = two_cameras();
    ASSERT_TRUE(write_calibration_toml(written, folder / "sub/calibration.toml").ok());
    const auto read = read_calibration(folder / "sub/calibration.toml");
    ASSERT_TRUE(read.ok()) << read.status();
    expect_cameras_near(*read, written, 0, 1e-15);
    EXPECT_EQ((*read)[0].camera_from_world.translation, written[0].camera_from_world.translation);
    // Nothing but the file is left behind.
    EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder / "sub"), {}), 1);
}

TEST(CalibrationToml, RefusesToWriteInvalidCameras) {
    const testing::TemporaryFolder folder;
    std::vector<Camera> cameras = two_cameras();
    cameras[1].fx = std::nan("");
    EXPECT_FALSE(write_calibration_toml(cameras, folder / "calibration.toml").ok());
    EXPECT_FALSE(std::filesystem::exists(folder / "calibration.toml"));
}

TEST(CalibrationToml, AcceptsAniposelibMetadataInFileOrder) {
    const std::string camera = R"(
name = "NAME"
size = [640, 480]
matrix = [[600.0, 0.0, 319.5], [0.0, 600.0, 239.5], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0, 0.0]
rotation = [0.0, 0.0, 0.0]
translation = [0.0, 0.0, 0.0]
)";
    const auto named = [&](const std::string& name) {
        return std::string(camera).replace(camera.find("NAME"), 4, name);
    };
    const auto read = parse_calibration_toml(
        "[cam_10]" + named("A") + "[cam_9]" + named("B") + "[metadata]\nadjusted = false\nerror = 0.3\n",
        "a.toml");
    ASSERT_TRUE(read.ok()) << read.status();
    ASSERT_EQ(read->size(), 2u);
    EXPECT_EQ((*read)[0].name, "cam_10");
    EXPECT_EQ((*read)[1].name, "cam_9");
}

TEST(CalibrationToml, ReadsEverySharedCalibration) {
    for (const char* name : {"balancing/calibration_published.toml", "balancing/calibration_refined.toml",
                             "studio/gesture/calibration.toml", "charuco/reference.toml"}) {
        KINEVOX_REQUIRE_DATA(file, name);
        const auto cameras = read_calibration(file);
        ASSERT_TRUE(cameras.ok()) << cameras.status();
        EXPECT_EQ(cameras->size(), 4u) << name;
    }
}

TEST(CalibrationQualisys, EqualsPublishedToml) {
    KINEVOX_REQUIRE_DATA(qualisys_file, "balancing/Calib.qca.txt");
    KINEVOX_REQUIRE_DATA(toml_file, "balancing/calibration_published.toml");
    const auto qualisys = read_calibration(qualisys_file);
    const auto published = read_calibration(toml_file);
    ASSERT_TRUE(qualisys.ok()) << qualisys.status();
    ASSERT_TRUE(published.ok()) << published.status();
    expect_cameras_near(*qualisys, *published, 1e-6, 1e-7);
}

TEST(CalibrationOpenCv, ReadsWhatOpenCvWrites) {
    const testing::TemporaryFolder folder;
    const std::vector<Camera> expected = two_cameras();
    {
        cv::FileStorage out((folder / "cameras.yml").string(), cv::FileStorage::WRITE);
        out << "calibration_time"
            << "today";
        for (const Camera& c : expected) {
            cv::Mat rotation(3, 3, CV_64F);
            std::copy(c.camera_from_world.rotation.m.begin(), c.camera_from_world.rotation.m.end(),
                      rotation.begin<double>());
            const Vec3 t = c.camera_from_world.translation;
            // OpenCV's writer wants names without spaces.
            out << (c.name == "left" ? "left" : "right") << "{"
                << "image_width" << c.width << "image_height" << c.height << "camera_matrix"
                << cv::Mat(cv::Matx33d(c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1)) << "distortion_coefficients"
                << cv::Mat(cv::Vec<double, 5>(c.k1, c.k2, c.p1, c.p2, c.k3)) << "rotation" << rotation
                << "translation" << cv::Mat(cv::Vec3d(t.x, t.y, t.z)) << "}";
        }
    }
    const auto read = read_calibration(folder / "cameras.yml");
    ASSERT_TRUE(read.ok()) << read.status();
    std::vector<Camera> renamed = expected;
    renamed[1].name = "right";
    expect_cameras_near(*read, renamed, 1e-10, 1e-14);
}

TEST(CalibrationOpenCv, ReadsOneCameraOfTheCalibrationSample) {
    const testing::TemporaryFolder folder;
    const auto file = folder.write("webcam.yml", R"(%YAML:1.0
---
calibration_time: "Mon"
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 600., 0., 319.5, 0., 601., 239.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.1, 0.2, 0., 1.e-3, 0. ]
avg_reprojection_error: 0.2
)");
    const auto read = read_calibration(file);
    ASSERT_TRUE(read.ok()) << read.status();
    ASSERT_EQ(read->size(), 1u);
    EXPECT_EQ((*read)[0].name, "webcam");
    EXPECT_EQ((*read)[0].fy, 601);
    EXPECT_EQ((*read)[0].p2, 1e-3);
    EXPECT_EQ((*read)[0].camera_from_world, Rigid3{});
}

TEST(CalibrationOpenCv, RoundTrips) {
    const testing::TemporaryFolder folder;
    const auto read = read_calibration(folder.write("c.yml", calibration_opencv_yaml(two_cameras())));
    ASSERT_TRUE(read.ok()) << read.status();
    expect_cameras_near(*read, two_cameras(), 1e-12, 1e-14);
}

TEST(CalibrationOpenCv, IsReadByOpenCv) {
    const testing::TemporaryFolder folder;
    std::vector<Camera> cameras = two_cameras();
    cameras[1].name = "right";
    const cv::FileStorage in(folder.write("c.yml", calibration_opencv_yaml(cameras)).string(),
                             cv::FileStorage::READ);
    cv::Mat matrix, translation;
    in["right"]["camera_matrix"] >> matrix;
    in["left"]["translation"] >> translation;
    ASSERT_EQ(matrix.size(), cv::Size(3, 3));
    EXPECT_EQ(matrix.at<double>(1, 2), cameras[1].cy);
    ASSERT_EQ(translation.size(), cv::Size(1, 3));
    EXPECT_EQ(translation.at<double>(1), cameras[0].camera_from_world.translation.y);
}

TEST(CalibrationKalibr, RoundTripsRelativeToFirstCamera) {
    const testing::TemporaryFolder folder;
    std::vector<Camera> cameras = two_cameras();
    cameras.push_back(cameras[0]);
    cameras[2].camera_from_world = {rotation_from_rodrigues({-0.3, 0.4, 0.5}), {1, 2, 3}};
    const auto read = read_calibration(folder.write("chain.yaml", calibration_kalibr_yaml(cameras)));
    ASSERT_TRUE(read.ok()) << read.status();
    const Rigid3 world_from_first = cameras[0].camera_from_world.inverse();
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        cameras[c].name = "cam" + std::to_string(c);
        cameras[c].k3 = 0;
        cameras[c].camera_from_world = cameras[c].camera_from_world * world_from_first;
    }
    expect_cameras_near(*read, cameras, 1e-12, 1e-12);
}

}  // namespace
}  // namespace kinevox
