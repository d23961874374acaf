#include "common/camera.h"

#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>
#include <random>

namespace kinevox {
namespace {

// A wide lens with strong distortion of every kind, looking at the origin from a corner.
Camera strong_camera() {
    Camera camera;
    camera.name = "strong";
    camera.width = 1280, camera.height = 720;
    camera.fx = 903.55, camera.fy = 907.88, camera.cx = 618.3, camera.cy = 394.2;
    camera.k1 = -0.332, camera.k2 = 0.0464, camera.p1 = -0.0043, camera.p2 = 0.0041, camera.k3 = 0.0666;
    camera.camera_from_world = {rotation_from_rodrigues({1.4, -0.9, 0.65}), {0.12, -0.21, 2.67}};
    return camera;
}

struct OpenCvCamera {
    cv::Mat matrix, distortion, rotation_vector, translation;
    explicit OpenCvCamera(const Camera& c)
        : matrix(cv::Matx33d(c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1)), distortion(1, 5, CV_64F) {
        const double d[5] = {c.k1, c.k2, c.p1, c.p2, c.k3};
        for (int i = 0; i < 5; ++i) distortion.at<double>(i) = d[i];
        const Vec3 r = rodrigues_from_rotation(c.camera_from_world.rotation);
        const Vec3 t = c.camera_from_world.translation;
        rotation_vector = cv::Mat(cv::Vec3d(r.x, r.y, r.z), true);
        translation = cv::Mat(cv::Vec3d(t.x, t.y, t.z), true);
    }
};

TEST(Camera, ProjectsAsOpenCv) {
    const Camera camera = strong_camera();
    const OpenCvCamera reference(camera);
    std::mt19937 random(1);
    std::uniform_real_distribution<double> coordinate(-1, 1);
    for (int i = 0; i < 1000; ++i) {
        const Vec3 point{coordinate(random), coordinate(random), coordinate(random)};
        std::vector<cv::Point2d> expected;
        cv::projectPoints(std::vector<cv::Point3d>{{point.x, point.y, point.z}}, reference.rotation_vector,
                          reference.translation, reference.matrix, reference.distortion, expected);
        const std::optional<Vec2> pixel = camera.project(point);
        ASSERT_TRUE(pixel);
        EXPECT_NEAR(pixel->x, expected[0].x, 1e-8);
        EXPECT_NEAR(pixel->y, expected[0].y, 1e-8);
    }
}

TEST(Camera, HasNoPixelForPointsBehindIt) {
    const Camera camera = strong_camera();
    const Ray forward = camera.ray_through({camera.cx, camera.cy});
    EXPECT_TRUE(camera.project(forward.origin_in_world + forward.direction_in_world));
    EXPECT_FALSE(camera.project(forward.origin_in_world - forward.direction_in_world));
    EXPECT_FALSE(camera.project(forward.origin_in_world));
}

TEST(Camera, UndistortsAsOpenCv) {
    const Camera camera = strong_camera();
    const OpenCvCamera reference(camera);
    for (double y = 0; y < camera.height; y += 79)
        for (double x = 0; x < camera.width; x += 71) {
            std::vector<cv::Point2d> expected;
            cv::undistortPoints(
                std::vector<cv::Point2d>{{x, y}}, expected, reference.matrix, reference.distortion,
                cv::noArray(), cv::noArray(),
                cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 200, 1e-12));
            const Ray ray = camera.ray_through({x, y});
            const Vec3 direction = camera.camera_from_world.rotation * ray.direction_in_world;
            EXPECT_NEAR(direction.x / direction.z, expected[0].x, 1e-8) << "pixel " << x << ", " << y;
            EXPECT_NEAR(direction.y / direction.z, expected[0].y, 1e-8) << "pixel " << x << ", " << y;
        }
}

TEST(Camera, RayThroughAPixelProjectsBackToIt) {
    const Camera camera = strong_camera();
    for (double y = 0; y < camera.height; y += 37)
        for (double x = 0; x < camera.width; x += 41) {
            const Ray ray = camera.ray_through({x, y});
            EXPECT_NEAR(norm(ray.direction_in_world), 1, 1e-12);
            const auto pixel = camera.project(ray.origin_in_world + 2.5 * ray.direction_in_world);
            ASSERT_TRUE(pixel);
            EXPECT_NEAR(pixel->x, x, 1e-9);
            EXPECT_NEAR(pixel->y, y, 1e-9);
        }
}

TEST(Geometry, RotationVectorsRoundTripUpToHalfATurn) {
    for (const double angle : {0.0, 1e-9, 1e-4, 1.0, 3.0, 3.14159265, M_PI}) {
        const Vec3 axis = normalized({0.3, -0.8, 0.5});
        const Mat3 rotation = rotation_from_rodrigues(angle * axis);
        const Mat3 back = rotation_from_rodrigues(rodrigues_from_rotation(rotation));
        for (int i = 0; i < 9; ++i) EXPECT_NEAR(back.m[i], rotation.m[i], 1e-14) << "angle " << angle;
    }
}

}  // namespace
}  // namespace kinevox
