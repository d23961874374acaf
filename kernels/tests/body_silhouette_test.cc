// The rendered silhouettes against a plain reference that walks along each capsule's axis for each pixel.
#include "kernels/body_silhouette.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <stdexcept>
#include <vector>

#include "kernels/shared/body_silhouette.h"
#include "kernels/tests/capsule_body.h"
#include "kernels/tests/tested_gpu.h"

namespace kinevox::kernels {
namespace {

using testing::camera_looking;
using testing::capsule_person;

struct Image {
    std::vector<std::uint8_t> mask;
    Rect bounds;
};

Image render(BodySilhouetteRenderer& renderer, const std::vector<TaperedCapsule>& body,
             const CameraModel& camera) {
    Image image;
    image.mask.assign(static_cast<std::size_t>(camera.width) * camera.height, 77);
    BodyView view{&camera, image.mask.data(), {}};
    renderer.render(body, std::span(&view, 1));
    image.bounds = view.bounds;
    return image;
}

struct Ball {
    double x, y, z, radius;  // camera frame
};

std::vector<Ball> balls_of(const std::vector<TaperedCapsule>& body, const CameraModel& camera) {
    std::vector<Ball> balls;
    constexpr int kSteps = 100;
    for (const TaperedCapsule& c : body) {
        for (int n = 0; n <= kSteps; ++n) {
            const double t = static_cast<double>(n) / kSteps;
            double p[3];
            for (int r = 0; r < 3; ++r) {
                p[r] = camera.translation_camera_from_world[r];
                for (int k = 0; k < 3; ++k)
                    p[r] += camera.rotation_camera_from_world[3 * r + k] * (c.a[k] + t * (c.b[k] - c.a[k]));
            }
            const double radius = c.radius_a + t * (c.radius_b - c.radius_a);
            if (p[2] - radius >= kNearest_m) balls.push_back({p[0], p[1], p[2], radius});
        }
    }
    return balls;
}

// Signed distance in px, about, of pixel (u, v) to the silhouette: negative inside.
double distance_px(const std::vector<Ball>& balls, const CameraModel& camera, int u, int v) {
    double x = (u - camera.cx) / camera.fx, y = (v - camera.cy) / camera.fy;
    const double xd = x, yd = y;
    for (int n = 0; n < 50 && (camera.k1 != 0 || camera.p1 != 0); ++n) {
        const double r2 = x * x + y * y, radial = 1 + r2 * (camera.k1 + r2 * (camera.k2 + r2 * camera.k3));
        const double dx = 2 * camera.p1 * x * y + camera.p2 * (r2 + 2 * x * x);
        const double dy = camera.p1 * (r2 + 2 * y * y) + 2 * camera.p2 * x * y;
        x = (xd - dx) / radial, y = (yd - dy) / radial;
    }
    const double scale = 1 / (x * x + y * y + 1);
    double least = 1e9;
    for (const Ball& ball : balls) {
        const double along = ball.x * x + ball.y * y + ball.z;
        const double across2 = ball.x * ball.x + ball.y * ball.y + ball.z * ball.z - along * along * scale;
        const double across = std::sqrt(std::max(0.0, across2));
        least = std::min(least, (across - ball.radius) * camera.fx / ball.z);
    }
    return least;
}

// What the CUDA form computes for each pixel, here on the CPU, so that it is tested without a GPU too.
bool ray_meets_body(const std::vector<TaperedCapsule>& body, const Projector& camera, int u, int v) {
    float x, y;
    undistorted(camera, static_cast<float>(u), static_cast<float>(v), x, y);
    return std::any_of(body.begin(), body.end(), [&](const TaperedCapsule& c) {
        CameraCapsule capsule;
        return capsule_in_camera(camera, c, capsule) && ray_meets_capsule(capsule, x, y);
    });
}

void expect_as_reference(const std::vector<TaperedCapsule>& body, const CameraModel& camera,
                         const Image& image, double tolerance_px) {
    const std::vector<Ball> balls = balls_of(body, camera);
    const Projector projector = make_projector(camera, "test");
    int set = 0, wrong = 0, wrong_rays = 0;
    Rect box{camera.width, camera.height, 0, 0};
    for (int y = 0; y < camera.height; ++y) {
        for (int x = 0; x < camera.width; ++x) {
            const std::uint8_t value = image.mask[static_cast<std::size_t>(y) * camera.width + x];
            ASSERT_TRUE(value == 0 || value == 255);
            const double distance = distance_px(balls, camera, x, y);
            wrong += value ? distance > tolerance_px : distance < -tolerance_px;
            const bool met = ray_meets_body(body, projector, x, y);
            wrong_rays += met ? distance > tolerance_px : distance < -tolerance_px;
            if (!value) continue;
            ++set;
            box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x + 1),
                   std::max(box.y1, y + 1)};
        }
    }
    EXPECT_EQ(wrong, 0) << "of " << set;
    EXPECT_EQ(wrong_rays, 0) << "of " << set;
    EXPECT_GT(set, 100);
    EXPECT_EQ(image.bounds, box);
}

CameraModel side_camera(int width, int height, float focal) {
    const float from[3] = {3.0f, -2.2f, 1.4f}, at[3] = {0.1f, 0, 0.95f};
    return camera_looking(from, at, width, height, focal);
}

class BodySilhouette : public ::testing::TestWithParam<Device> {
  protected:
    void SetUp() override {
        try {
            renderer = make_body_silhouette_renderer(GetParam());
        } catch (const std::runtime_error& error) {
            EXPECT_THAT(error.what(), ::testing::HasSubstr("use device cpu"));
            if (std::getenv("KINEVOX_REQUIRE_GPU")) FAIL() << "a GPU was asked for, but: " << error.what();
            GTEST_SKIP() << "no GPU: " << error.what();
        }
    }
    std::unique_ptr<BodySilhouetteRenderer> renderer;
};
INSTANTIATE_TEST_SUITE_P(Devices, BodySilhouette, ::testing::Values(Device::kCpu, testing::tested_gpu()),
                         [](const auto& info) { return info.param == Device::kCpu ? "Cpu" : "Cuda"; });

TEST_P(BodySilhouette, MatchesReferenceInPinholeCameras) {
    for (const float heading : {0.f, 1.1f, 2.9f}) {
        const auto body = capsule_person(0.1f, 0.05f, heading, 0.5f);
        for (const CameraModel& camera : {side_camera(96, 96, 150), side_camera(150, 200, 330)})
            expect_as_reference(body, camera, render(*renderer, body, camera), 0.15);
    }
}

TEST_P(BodySilhouette, MatchesReferenceWithDistortion) {
    CameraModel camera = side_camera(200, 150, 165);
    camera.k1 = -0.25f, camera.k2 = 0.08f, camera.p1 = 0.002f, camera.p2 = -0.001f;
    const auto body = capsule_person(0.3f, 0.6f, 0.4f, 0.7f);
    expect_as_reference(body, camera, render(*renderer, body, camera), 0.15);
    camera.k1 = 0.2f;
    expect_as_reference(body, camera, render(*renderer, body, camera), 0.15);
}

TEST_P(BodySilhouette, HandlesCapsulesEndOnAndNested) {
    const CameraModel camera = side_camera(128, 128, 180);
    const float eye[3] = {3.0f, -2.2f, 1.4f};
    const auto towards = [&](float t, int k) { return 0.1f * (k == 0) + t * (eye[k] - 0.1f * (k == 0)); };
    for (const float rb : {0.05f, 0.15f, 0.3f}) {
        const std::vector<TaperedCapsule> body{{{towards(0, 0), towards(0, 1), towards(0, 2) + 0.8f},
                                                {towards(0.3f, 0), towards(0.3f, 1), towards(0.3f, 2) + 0.6f},
                                                0.15f,
                                                rb},
                                               {{0, 0, 1.2f}, {0, 0, 1.2f}, 0.1f, 0.1f},       // a ball
                                               {{0.2f, 0, 0.5f}, {0.2f, 0, 0.9f}, 0.f, 0.1f},  // a cone
                                               {{0, 0.1f, 0.7f}, {0, 0.15f, 0.75f}, 0.2f, 0.05f}};
        expect_as_reference(body, camera, render(*renderer, body, camera), 0.15);
    }
}

TEST_P(BodySilhouette, ClipsAtImageBorderAndBehindCamera) {
    const CameraModel camera = side_camera(128, 96, 400);  // sees the trunk only
    const auto body = capsule_person(0, 0, 0, 0.3f);
    const Image image = render(*renderer, body, camera);
    expect_as_reference(body, camera, image, 0.15);
    EXPECT_EQ(image.bounds.y0, 0);
    EXPECT_EQ(image.bounds.y1, 96);
    const Image behind = render(*renderer, capsule_person(6, -5, 0, 0), camera);
    EXPECT_TRUE(behind.bounds.empty());
    EXPECT_THAT(behind.mask, ::testing::Each(0));
    // A bar from before the camera to behind it: only its front part is there.
    const std::vector<TaperedCapsule> bar{{{0, 0, 1}, {6, -4.4f, 1}, 0.1f, 0.1f}};
    EXPECT_FALSE(render(*renderer, bar, camera).bounds.empty());
}

TEST_P(BodySilhouette, RendersManyViewsRepeatedly) {
    const auto body = capsule_person(0, 0, 0.7f, 0.4f);
    std::vector<CameraModel> cameras{side_camera(96, 96, 150), side_camera(128, 64, 90),
                                     side_camera(64, 96, 120)};
    cameras[1].k1 = -0.1f;
    std::vector<std::vector<std::uint8_t>> masks;
    std::vector<BodyView> views;
    for (const CameraModel& camera : cameras)
        masks.emplace_back(static_cast<std::size_t>(camera.width) * camera.height);
    for (std::size_t n = 0; n < cameras.size(); ++n) views.push_back({&cameras[n], masks[n].data(), {}});
    for (int again = 0; again < 2; ++again) {
        renderer->render(body, views);
        for (std::size_t n = 0; n < cameras.size(); ++n) {
            const Image alone = render(*renderer, body, cameras[n]);
            EXPECT_EQ(masks[n], alone.mask);
            EXPECT_EQ(views[n].bounds, alone.bounds);
        }
    }
}

TEST_P(BodySilhouette, HandlesEmptyAndRejectsInvalidInput) {
    const CameraModel camera = side_camera(64, 64, 100);
    EXPECT_TRUE(render(*renderer, {}, camera).bounds.empty());
    EXPECT_THROW(render(*renderer, {{{0, 0, 1}, {0, 0, 2}, -0.1f, 0.1f}}, camera), std::invalid_argument);
    EXPECT_THROW(render(*renderer, {{{0, NAN, 1}, {0, 0, 2}, 0.1f, 0.1f}}, camera), std::invalid_argument);
    CameraModel none = camera;
    none.fx = 0;
    EXPECT_THROW(render(*renderer, capsule_person(0, 0, 0, 0), none), std::invalid_argument);
}

}  // namespace
}  // namespace kinevox::kernels
