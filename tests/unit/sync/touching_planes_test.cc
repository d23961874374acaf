// Tangent planes of cameras with known extrinsics are equal at the same instant, and only then.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "server/sync/offsets.h"
#include "server/sync/signals.h"

namespace kinevox::sync {
namespace {

using ::testing::HasSubstr;

constexpr double kVideoFps = 30;

// At a position, looking at the centre of the room.
Camera camera_at(const std::string& name, Vec3 place) {
    Camera camera;
    camera.name = name, camera.width = 640, camera.height = 480;
    camera.fx = camera.fy = 520, camera.cx = 319.5, camera.cy = 239.5;
    const Vec3 z = normalized(Vec3{0, 0, 1} - place), x = normalized(cross(z, {0, 0, 1})), y = cross(z, x);
    camera.camera_from_world.rotation.m = {x.x, x.y, x.z, y.x, y.y, y.z, z.x, z.y, z.z};
    camera.camera_from_world.translation = -(camera.camera_from_world.rotation * place);
    return camera;
}

// Eight corners of a box that moves, rises and grows without repetition.
CameraMotion seen_by(const Camera& camera, double begins_s, int images) {
    CameraMotion motion{camera, {}};
    double before = 0;
    for (int n = 0; n < images; ++n) {
        const double t = begins_s + n / kVideoFps;
        const Vec3 middle{0.8 * std::sin(0.9 * t), 0.6 * std::cos(0.7 * t),
                          0.9 + 0.25 * std::sin(2.3 * t) * std::sin(0.31 * t)};
        const Vec3 half{0.2 + 0.1 * std::sin(1.7 * t), 0.15, 0.8 + 0.1 * std::sin(3.1 * t + 1)};
        SilhouetteShape shape;
        shape.seen = true;
        shape.top_px = 1e9, shape.bottom_px = -1e9;
        double left = 1e9, right = -1e9;
        for (int corner = 0; corner < 8; ++corner) {
            const Vec3 point = middle + Vec3{corner & 1 ? half.x : -half.x, corner & 2 ? half.y : -half.y,
                                             corner & 4 ? half.z : -half.z};
            const Vec2 pixel = *camera.project(point);
            shape.hull.push_back(pixel);
            shape.hull_at_border.push_back(false);
            shape.top_px = std::min(shape.top_px, pixel.y),
            shape.bottom_px = std::max(shape.bottom_px, pixel.y);
            left = std::min(left, pixel.x), right = std::max(right, pixel.x);
        }
        shape.area_px2 = (right - left) * (shape.bottom_px - shape.top_px);
        shape.centroid_y_px = (shape.top_px + shape.bottom_px) / 2;
        shape.changed_px2 = n > 0 ? 400 + std::abs(shape.area_px2 - before) : std::nan("");
        before = shape.area_px2;
        motion.shapes.push_back(shape);
    }
    return motion;
}

std::vector<Camera> three_cameras() {
    return {camera_at("a", {4, 0, 1.5}), camera_at("b", {0.5, 4.5, 2.2}), camera_at("c", {-3, -3, 1.2})};
}

TEST(TouchingPlanes, EqualInBothCameras) {
    const std::vector<Camera> cameras = three_cameras();
    std::vector<CameraMotion> motions;
    for (const Camera& camera : cameras) motions.push_back(seen_by(camera, 0, 120));
    const auto pairs = pair_signals(motions, kVideoFps);
    ASSERT_EQ(pairs.size(), 3u);
    for (const PairSignals& pair : pairs) {
        ASSERT_EQ(pair.equal_px.size(), 2u);
        for (const auto& [x, y] : pair.equal_px) {
            double range = 0;
            for (std::size_t n = 0; n < x.size(); ++n)
                if (!std::isnan(x[n]) && !std::isnan(y[n])) {
                    EXPECT_NEAR(x[n], y[n], 1e-6);
                    range = std::max(range, std::abs(x[n] - x[n / 2]));
                }
            EXPECT_GT(range, 5) << "px: there is something to see";
        }
    }
}

TEST(Align, FindsStartsOfSyntheticCameras) {
    const std::vector<Camera> cameras = three_cameras();
    const double begins[] = {0.0, 1.2 + 0.5 / kVideoFps, 0.4};
    std::vector<CameraMotion> motions;
    for (std::size_t c = 0; c < 3; ++c)
        motions.push_back(seen_by(cameras[c], begins[c], 200 - 20 * static_cast<int>(c)));
    const auto aligned = align(motions, kVideoFps, {});
    ASSERT_TRUE(aligned.ok()) << aligned.status();
    EXPECT_TRUE(aligned->used_extrinsics);
    for (std::size_t c = 0; c < 3; ++c)
        EXPECT_NEAR(aligned->solution.cameras[c].offset_s, begins[c], 0.2 / kVideoFps) << c;
}

TEST(Align, NamesCameraWithoutPerson) {
    std::vector<CameraMotion> motions;
    for (const Camera& camera : three_cameras()) motions.push_back(seen_by(camera, 0, 150));
    for (std::size_t n = 20; n < motions[1].shapes.size(); ++n) motions[1].shapes[n] = {};
    const auto aligned = align(motions, kVideoFps, {});
    ASSERT_FALSE(aligned.ok());
    EXPECT_THAT(std::string(aligned.status().message()),
                HasSubstr("camera b: a person is visible in only 20 of 150 images"));
}

TEST(Align, UsesMovementAloneWithoutExtrinsics) {
    std::vector<CameraMotion> motions;
    for (const Camera& camera : three_cameras()) motions.push_back(seen_by(camera, 0, 200));
    for (CameraMotion& motion : motions)
        motion.camera.camera_from_world = Rigid3();  // as in a calibration without extrinsics
    for (const PairSignals& pair : pair_signals(motions, kVideoFps)) EXPECT_TRUE(pair.equal_px.empty());
}

}  // namespace
}  // namespace kinevox::sync
