// The fit on silhouettes that the model itself throws: what it must find, and what it must refuse.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/key_poses.h"
#include "server/pose/limb_search.h"
#include "server/pose/main_body.h"
#include "server/pose/pose_estimate.h"
#include "server/pose/pose_tracker.h"
#include "server/pose/posture_filter.h"
#include "server/pose/ray_capsule.h"
#include "server/pose/silhouette_rays.h"

namespace kinevox {
namespace {

constexpr double deg(double degrees) {
    return degrees * std::numbers::pi / 180;
}
constexpr int kWidth = 320, kHeight = 240;

// Four cameras around the origin, 4 m away, looking at the height of the hips.
std::vector<Camera> ring(int count = 4) {
    std::vector<Camera> cameras;
    for (int k = 0; k < count; ++k) {
        const double turn = 2 * std::numbers::pi * (k + 0.3) / count;
        const Vec3 centre{4 * std::cos(turn), 4 * std::sin(turn), 1.6}, target{0, 0, 0.9};
        const Vec3 forward = normalized(target - centre), right = normalized(cross(forward, {0, 0, 1})),
                   down = cross(forward, right);
        Camera camera;
        camera.name = "cam" + std::to_string(k);
        camera.width = kWidth, camera.height = kHeight;
        camera.fx = camera.fy = 330;
        camera.cx = (kWidth - 1) / 2.0, camera.cy = (kHeight - 1) / 2.0;
        camera.camera_from_world.rotation = {
            {right.x, right.y, right.z, down.x, down.y, down.z, forward.x, forward.y, forward.z}};
        camera.camera_from_world.translation = -(camera.camera_from_world.rotation * centre);
        cameras.push_back(camera);
    }
    return cameras;
}

// A pixel is set where its viewing ray goes through a capsule.
kernels::Silhouettes render(const Camera& camera, const std::vector<BodyCapsule>& capsules) {
    kernels::Silhouettes s;
    s.width = camera.width, s.height = camera.height;
    s.sharp.assign(static_cast<std::size_t>(camera.width) * camera.height, 0);
    s.bounds = {camera.width, camera.height, 0, 0};
    ContourRays rays;
    rays.origin_in_world = camera.centre_in_world();
    for (int y = 0; y < camera.height; ++y)
        for (int x = 0; x < camera.width; ++x) {
            const Vec3 d =
                camera.ray_through({static_cast<double>(x), static_cast<double>(y)}).direction_in_world;
            const float direction[3] = {static_cast<float>(d.x), static_cast<float>(d.y),
                                        static_cast<float>(d.z)};
            for (int axis = 0; axis < 3; ++axis) {
                rays.direction[axis].push_back(direction[axis]);
                rays.outward[axis].push_back(0);
            }
        }
    std::vector<float> distance;
    std::vector<int> which;
    nearest_capsules(rays, capsules, distance, which);
    for (int y = 0; y < camera.height; ++y)
        for (int x = 0; x < camera.width; ++x) {
            const std::size_t k = static_cast<std::size_t>(y) * camera.width + x;
            if (!(distance[k] < 0)) continue;
            s.sharp[k] = 255;
            ++s.sharp_pixels;
            s.bounds = {std::min(s.bounds.x0, x), std::min(s.bounds.y0, y), std::max(s.bounds.x1, x + 1),
                        std::max(s.bounds.y1, y + 1)};
        }
    if (s.sharp_pixels == 0) s.bounds = {};
    return s;
}

struct Scene {
    std::vector<Camera> cameras = ring();
    std::shared_ptr<const BodyModel> model = std::make_shared<BodyModel>(default_body_shape(1.75));

    BodyCoordinates standing() const {
        BodyCoordinates q{};
        q[2] = 0.96;
        q[5] = deg(25);
        q[kDofShoulderL + 1] = deg(-35), q[kDofShoulderR] = deg(40), q[kDofElbowR] = deg(60),
                          q[kDofElbowL] = deg(20);
        q[kDofHipL] = deg(25), q[kDofKneeL] = deg(35), q[kDofHipR] = deg(-5), q[kDofKneeR] = deg(10);
        return q;
    }
    std::vector<SilhouetteRays> see(const BodyCoordinates& q) const {
        std::vector<BodyCapsule> capsules;
        model->capsules(model->forward(q), capsules);
        std::vector<SilhouetteRays> views(cameras.size());
        for (std::size_t c = 0; c < cameras.size(); ++c)
            read_silhouette(cameras[c], render(cameras[c], capsules), {}, views[c]);
        return views;
    }
    double error_m(const BodyPosture& posture, const BodyCoordinates& truth) const {
        const PosedBody a = model->forward(posture), b = model->forward(truth);
        double sum = 0;
        for (std::size_t j = 0; j < kJointNames.size(); ++j)
            sum += norm(a.joints_in_world[j] - b.joints_in_world[j]);
        return sum / kJointNames.size();
    }
};

TEST(PoseFit, RecoversThePoseThatThrewTheSilhouettes) {
    const Scene scene;
    const BodyCoordinates truth = scene.standing();
    const auto views = scene.see(truth);
    BodyCoordinates start = truth;
    for (int k = 0; k < kBodyDofCount; ++k) start[k] += (k % 2 == 0 ? 1 : -1) * (k < 3 ? 0.03 : deg(8));
    PoseFitter fitter;
    const PoseFit fit = fitter.fit(*scene.model, views, posture_from_coordinates(start), nullptr, true);
    EXPECT_LT(scene.error_m(fit.posture, truth), 0.015);
    EXPECT_GT(fit.explained, 0.95);
    EXPECT_LT(fit.contour_rms_m, 0.01);
}

TEST(PoseFit, OneCameraOfFourMayBeMissing) {
    const Scene scene;
    const BodyCoordinates truth = scene.standing();
    auto views = scene.see(truth);
    views[2].camera = nullptr;
    BodyCoordinates start = truth;
    for (int k = 3; k < kBodyDofCount; ++k) start[k] += (k % 2 == 0 ? 1 : -1) * deg(5);
    PoseFitter fitter;
    const PoseFit fit = fitter.fit(*scene.model, views, posture_from_coordinates(start), nullptr, true);
    EXPECT_LT(scene.error_m(fit.posture, truth), 0.025);
}

TEST(PoseFit, KeepsJointsWithinTheirLimits) {
    const Scene scene;
    BodyCoordinates bent = scene.standing();
    bent[kDofKneeL] = deg(-40);  // no knee bends that way
    const auto views = scene.see(bent);
    PoseFitter fitter;
    const PoseFit fit =
        fitter.fit(*scene.model, views, posture_from_coordinates(scene.standing()), nullptr, true);
    EXPECT_GT(coordinates_from_posture(fit.posture)[kDofKneeL], deg(-12));
}

TEST(PoseTracker, FindsABodyItKnowsNothingOf) {
    const Scene scene;
    const BodyCoordinates truth = scene.standing();
    const auto views = scene.see(truth);
    PoseTracker tracker(30);
    tracker.set_model(scene.model);
    const auto tracked = tracker.update(0, views, {0, 0, 0.95}, {});
    ASSERT_TRUE(tracked.has_value());
    EXPECT_LT(scene.error_m(tracked->fit.posture, truth), 0.03) << "left and right are told apart, too";
}

// One arm raised, the other bent in front; both of the model's arms lie in the raised one.
TEST(LimbSearch, PartsArmsThatLieInOnePlace) {
    const Scene scene;
    BodyCoordinates truth = scene.standing();
    truth[kDofShoulderL] = deg(80), truth[kDofShoulderL + 1] = 0, truth[kDofElbowL] = deg(10);
    truth[kDofShoulderR] = deg(-30), truth[kDofShoulderR + 1] = deg(-30), truth[kDofElbowR] = deg(100);
    const auto views = scene.see(truth);
    BodyCoordinates start = truth;
    start[kDofShoulderR] = deg(80), start[kDofShoulderR + 1] = deg(30), start[kDofElbowR] = deg(10);
    start[kDofShoulderL] = deg(20), start[kDofElbowL] = deg(90);
    LimbSearch search;
    PoseFitter fitter;
    const auto moved = search.improve_pair(*scene.model, posture_from_coordinates(start), views, Limb::kArmL,
                                           Limb::kArmR, 0.08);
    ASSERT_TRUE(moved.has_value());
    EXPECT_LT(scene.error_m(fitter.fit(*scene.model, views, *moved, nullptr, true).posture, truth), 0.02);
    EXPECT_GT(
        scene.error_m(fitter.fit(*scene.model, views, posture_from_coordinates(start), nullptr, true).posture,
                      truth),
        0.05)
        << "the descent alone does not get there";
}

// Marks the voxels of a box given by its lowest and highest ones.
void fill(kernels::VoxelVolume& volume, const int low[3], const int high[3]) {
    const int bricks[3] = {volume.lattice.size[0] / 8, volume.lattice.size[1] / 8,
                           volume.lattice.size[2] / 8};
    for (int z = 0; z < bricks[2]; ++z)
        for (int y = 0; y < bricks[1]; ++y)
            for (int x = 0; x < bricks[0]; ++x) {
                kernels::Brick brick{};
                brick.x = x, brick.y = y, brick.z = z;
                bool any = false;
                for (int k = 0; k < 8; ++k)
                    for (int bit = 0; bit < 64; ++bit) {
                        const int at[3] = {8 * x + bit % 8, 8 * y + bit / 8, 8 * z + k};
                        bool inside = true;
                        for (int a = 0; a < 3; ++a) inside = inside && at[a] >= low[a] && at[a] <= high[a];
                        if (inside) brick.occupancy[k] |= std::uint64_t{1} << bit, any = true;
                    }
                if (any) volume.bricks.push_back(brick);
            }
}

TEST(MainBody, KeepsLegsUnderTheTrunkAndLeavesTheChair) {
    kernels::VoxelVolume coarse;
    coarse.lattice.voxel_m = 0.04f;
    for (int a = 0; a < 3; ++a) coarse.lattice.origin[a] = 0, coarse.lattice.size[a] = 64;
    const int trunk_low[3] = {20, 20, 24}, trunk_high[3] = {29, 29, 40}, legs_low[3] = {20, 20, 0},
              legs_high[3] = {26, 26, 12}, chair_low[3] = {50, 50, 0}, chair_high[3] = {58, 58, 12};
    fill(coarse, trunk_low, trunk_high);
    fill(coarse, legs_low, legs_high);
    fill(coarse, chair_low, chair_high);
    const auto body = main_body(coarse);
    ASSERT_TRUE(body.has_value());
    std::int64_t voxels = 0;
    for (const kernels::Brick& brick : body->volume.bricks)
        for (const std::uint64_t layer : brick.occupancy) voxels += std::popcount(layer);
    EXPECT_EQ(voxels, 10 * 10 * 17 + 7 * 7 * 13);
}

TEST(PoseTracker, EmptySilhouettesGiveNoPose) {
    const Scene scene;
    std::vector<SilhouetteRays> views(scene.cameras.size());
    PoseTracker tracker(30);
    EXPECT_FALSE(tracker.update(0, views, {0, 0, 1}, {}).has_value());
    kernels::Silhouettes empty;
    empty.width = kWidth, empty.height = kHeight;
    empty.sharp.assign(kWidth * kHeight, 0);
    read_silhouette(scene.cameras[0], empty, {}, views[0]);
    EXPECT_EQ(views[0].camera, nullptr);
}

TEST(PoseTracker, FullSilhouettesGiveNoPose) {
    const Scene scene;
    kernels::Silhouettes full;
    full.width = kWidth, full.height = kHeight;
    full.sharp.assign(kWidth * kHeight, 255);
    full.sharp_pixels = kWidth * kHeight;
    full.bounds = {0, 0, kWidth, kHeight};
    std::vector<SilhouetteRays> views(scene.cameras.size());
    for (std::size_t c = 0; c < views.size(); ++c) read_silhouette(scene.cameras[c], full, {}, views[c]);
    EXPECT_EQ(views[0].contour.size(), 0u) << "the picture's edge is no border";
    PoseTracker tracker(30);
    for (int frame = 0; frame < 8; ++frame)
        EXPECT_FALSE(tracker.update(frame * 33'000'000LL, views, {0, 0, 1}, {}).has_value());
}

TEST(PoseEstimate, WithholdsWhatNoCameraShows) {
    Scene scene;
    const BodyCoordinates truth = scene.standing();
    std::vector<BodyCapsule> capsules;
    scene.model->capsules(scene.model->forward(truth), capsules);
    std::vector<SilhouetteRays> views(scene.cameras.size());
    for (std::size_t c = 0; c < views.size(); ++c) {
        Camera& camera = scene.cameras[c];
        camera.height = 120;  // the legs lie below the picture
        read_silhouette(camera, render(camera, capsules), {}, views[c]);
    }
    PoseCost cost;
    Linearisation data;
    const BodyPosture posture = posture_from_coordinates(truth);
    cost.linearise(*scene.model, posture, views, nullptr, 0.04, data);
    BodyPose pose;
    judge_posture(*scene.model, posture, data, cost.terms(), cost.capsules(), 4, {}, pose);
    describe_posture(*scene.model, posture, pose);
    const JointEstimate &ankle = pose.joints[*joint_index("ankle_l")],
                        &shoulder = pose.joints[*joint_index("shoulder_l")];
    EXPECT_FALSE(ankle.measured());
    EXPECT_TRUE(std::isnan(ankle.in_world.x));
    EXPECT_TRUE(shoulder.measured()) << shoulder.withheld;
    EXPECT_GT(ankle.std_m, 3 * shoulder.std_m);
    EXPECT_FALSE(pose.angles[*angle_index("knee_flexion_l")].measured());
    EXPECT_EQ(shoulder.cameras, 4);
}

TEST(PostureFilter, ZeroPhaseKeepsASlowMovementInPlace) {
    std::vector<std::optional<BodyPosture>> postures, noisy;
    for (int n = 0; n < 120; ++n) {
        BodyCoordinates q{};
        q[0] = 0.01 * n;
        q[kDofKneeL] = deg(40) + deg(30) * std::sin(0.08 * n);
        postures.emplace_back(posture_from_coordinates(q));
        q[kDofKneeL] += deg(4) * (n % 2 == 0 ? 1 : -1);
        noisy.emplace_back(posture_from_coordinates(q));
    }
    noisy[50].reset();
    smooth_zero_phase(noisy, 60, 6);
    EXPECT_FALSE(noisy[50].has_value());
    for (const int n : {10, 30, 70, 100}) {
        const double wanted = coordinates_from_posture(*postures[n])[kDofKneeL];
        EXPECT_NEAR(coordinates_from_posture(*noisy[n])[kDofKneeL], wanted, deg(0.7)) << n;
        EXPECT_NEAR(noisy[n]->root_in_world.x, 0.01 * n, 1e-4);
    }
}

TEST(PostureFilter, OneEuroCalmsRestAndFollowsMovement) {
    OneEuroPosture filter;
    BodyCoordinates q{};
    double calm = 0;
    for (int n = 0; n < 60; ++n) {
        q[kDofElbowL] = deg(60) + deg(2) * (n % 2 == 0 ? 1 : -1);
        const double out = coordinates_from_posture(
            filter.filter(posture_from_coordinates(q), n * 16'666'667LL))[kDofElbowL];
        if (n > 30) calm = std::max(calm, std::abs(out - deg(60)));
    }
    EXPECT_LT(calm, deg(1.6));
    double lag = 0;
    for (int n = 60; n < 80; ++n) {
        q[kDofElbowL] += deg(3);
        lag = q[kDofElbowL] - coordinates_from_posture(
                                  filter.filter(posture_from_coordinates(q), n * 16'666'667LL))[kDofElbowL];
    }
    EXPECT_LT(lag, deg(6));
}

}  // namespace
}  // namespace kinevox
