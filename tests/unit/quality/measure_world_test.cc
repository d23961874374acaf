// The world's tilt from the cameras' rolls and a person who stands.
#include <gtest/gtest.h>

#include "common/geometry.h"
#include "server/quality/samples.h"
#include "server/silhouettes/silhouettes.h"
#include "tests/unit/pipeline/scene.h"

namespace kinevox::quality {
namespace {

using kinevox::testing::body_at;
using kinevox::testing::camera_at;
using kinevox::testing::kStandingCentre_m;
using kinevox::testing::silhouettes_of;

std::vector<Camera> three_cameras() {
    return {camera_at("north", {4, 4, 2.2}, {0, 0, 1}), camera_at("east", {4, -4, 1.8}, {0, 0, 1}),
            camera_at("west", {-4, 3, 1.6}, {0, 0, 1})};
}

// Of a person who stands near the middle.
SilhouetteSet silhouettes_in(const std::vector<Camera>& cameras) {
    SilhouetteSet set;
    for (int n = 0; n < 6; ++n) {
        auto& images = set.frame_sets.emplace_back();
        for (const Camera& camera : cameras)
            images.push_back({silhouettes_of(camera, body_at({0.05 * n, 0, kStandingCentre_m})).sharp});
    }
    return set;
}

TEST(MeasureWorld, FindsTiltOfWorldWithThreeCameras) {
    Samples seen{.cameras = three_cameras(), .background = {}, .samples = {}};
    const SilhouetteSet subject = silhouettes_in(seen.cameras);
    EXPECT_LT(measure_world(seen, subject).tilt_deg.value_or(90), 1);
    for (Camera& camera : seen.cameras)
        camera.camera_from_world.rotation = camera.camera_from_world.rotation * rotation_x(15 * kDegree);
    EXPECT_NEAR(measure_world(seen, subject).tilt_deg.value_or(0), 15, 1);
}

TEST(MeasureWorld, TakesRolledCameraForNoTiltWhereSubjectIsUpright) {
    std::vector<Camera> cameras = three_cameras();
    Rigid3& rolled = cameras[0].camera_from_world;
    rolled.rotation = rotation_z(25 * kDegree) * rolled.rotation;
    rolled.translation = rotation_z(25 * kDegree) * rolled.translation;
    const Samples seen{.cameras = cameras, .background = {}, .samples = {}};
    EXPECT_FALSE(measure_world(seen, silhouettes_in(cameras)).tilt_deg.has_value());
}

}  // namespace
}  // namespace kinevox::quality
