// The pose fit on silhouettes rendered from the model.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "common/geometry.h"
#include "server/pose/body_model.h"
#include "server/pose/foot_turn.h"
#include "server/pose/key_poses.h"
#include "server/pose/limb_search.h"
#include "server/pose/main_body.h"
#include "server/pose/pose_estimate.h"
#include "server/pose/pose_stage.h"
#include "server/pose/pose_tracker.h"
#include "server/pose/posture_filter.h"
#include "server/pose/ray_capsule.h"
#include "server/pose/retrack.h"
#include "server/pose/silhouette_rays.h"
#include "server/pose/turned_posture.h"
#include "tests/support/seen_body.h"

namespace kinevox {
namespace {

using Scene = testing::SeenBody;

TEST(PoseFit, RecoversPoseOfSilhouettes) {
    const Scene scene;
    const BodyCoordinates truth = scene.standing();
    const auto views = scene.see(truth);
    BodyCoordinates start = truth;
    for (int k = 0; k < kBodyDofCount; ++k) start[k] += (k % 2 == 0 ? 1 : -1) * (k < 3 ? 0.03 : radians(8));
    PoseFitter fitter;
    const PoseFit fit = fitter.fit(*scene.model, views, posture_from_coordinates(start), nullptr, true);
    EXPECT_LT(scene.error_m(fit.posture, truth), 0.015);
    EXPECT_GT(fit.explained, 0.95);
    EXPECT_LT(fit.contour_residual_rms_m, 0.01);
}

TEST(PoseFit, ToleratesOneMissingCamera) {
    const Scene scene;
    const BodyCoordinates truth = scene.standing();
    auto views = scene.see(truth);
    views[2].camera = nullptr;
    BodyCoordinates start = truth;
    for (int k = 3; k < kBodyDofCount; ++k) start[k] += (k % 2 == 0 ? 1 : -1) * radians(5);
    PoseFitter fitter;
    const PoseFit fit = fitter.fit(*scene.model, views, posture_from_coordinates(start), nullptr, true);
    EXPECT_LT(scene.error_m(fit.posture, truth), 0.025);
}

TEST(PoseFit, KeepsJointsWithinLimits) {
    const Scene scene;
    BodyCoordinates bent = scene.standing();
    bent[kDofKneeL] = radians(-40);  // not a possible knee angle
    const auto views = scene.see(bent);
    PoseFitter fitter;
    const PoseFit fit =
        fitter.fit(*scene.model, views, posture_from_coordinates(scene.standing()), nullptr, true);
    EXPECT_GT(coordinates_from_posture(fit.posture)[kDofKneeL], radians(-12));
}

// The right half of a square may show another subject.
TEST(SilhouetteRays, HasNoContourInSharedForegroundButAllowsTheBodyThere) {
    Camera camera;
    camera.width = 200, camera.height = 150;
    camera.fx = camera.fy = 200, camera.cx = 99.5, camera.cy = 74.5;
    kernels::Silhouettes seen;
    seen.width = 200, seen.height = 150;
    seen.sharp.assign(200 * 150, 0);
    ForegroundPart shared{std::vector<std::uint8_t>(seen.sharp.size(), 0), {100, 40, 160, 110}};
    for (int y = 40; y < 110; ++y)
        for (int x = 60; x < 160; ++x) {
            if (x < 120) seen.sharp[y * 200 + x] = 255, ++seen.sharp_pixels;
            if (x >= 100) shared.mask[y * 200 + x] = 255;
        }
    seen.bounds = {60, 40, 120, 110};
    seen.loose = seen.sharp;
    SilhouetteRays whole, with_other;
    read_silhouette(camera, seen, {}, whole);
    read_silhouette(camera, seen, {}, with_other, {}, &shared);
    const auto rightmost = [](const SilhouetteRays& rays) {
        return *std::ranges::max_element(rays.contour.direction[0]);
    };
    EXPECT_NEAR(rightmost(whole), (119.5 - 99.5) / 200, 0.01);
    EXPECT_LT(rightmost(with_other), (101 - 99.5) / 200);
    const std::optional<double> own_px = whole.distance.at({140, 75}),
                                shared_px = with_other.distance.at({140, 75});
    ASSERT_TRUE(own_px);
    ASSERT_TRUE(shared_px);
    EXPECT_NEAR(*own_px, -20.5, 2);
    EXPECT_NEAR(*shared_px, 19.5, 2);
    // 2 m before the camera, which looks along z.
    const auto at_column = [&](double x) { return Vec3{2 * (x - 99.5) / 200, 0, 2}; };
    EXPECT_TRUE(with_other.shows_alone(at_column(80)));
    EXPECT_FALSE(with_other.shows_alone(at_column(130)));
    EXPECT_TRUE(whole.shows_alone(at_column(130)));
    EXPECT_FALSE(whole.shows_alone(at_column(230))) << "outside the image";
    EXPECT_TRUE(is_among_others(std::vector{whole, with_other}, at_column(130)));
    EXPECT_FALSE(is_among_others(std::vector{whole, with_other}, at_column(80)));
    EXPECT_FALSE(is_among_others(std::vector{whole, whole, with_other}, at_column(130)));
    EXPECT_FALSE(is_among_others(std::vector{whole}, at_column(130))) << "no other subject is there";
}

// The right part of the clothes is missing in the silhouette.
TEST(SilhouetteRays, FindsBorderAcrossClothes) {
    constexpr int kWidth = 200, kHeight = 150;
    Camera camera;
    camera.width = kWidth, camera.height = kHeight;
    camera.fx = camera.fy = 200, camera.cx = 99.5, camera.cy = 74.5;
    kernels::Silhouettes seen;
    seen.width = kWidth, seen.height = kHeight;
    seen.bounds = {60, 40, 120, 110};
    seen.sharp.assign(kWidth * kHeight, 0);
    const auto rays_in = [&](std::uint8_t background, std::uint8_t clothes) {
        std::vector<std::uint8_t> pixels(kWidth * kHeight, background);
        seen.sharp_pixels = 0;
        for (int y = 40; y < 110; ++y)
            for (int x = 60; x < 160; ++x) {
                pixels[y * kWidth + x] = clothes;
                if (x < seen.bounds.x1) seen.sharp[y * kWidth + x] = 255, ++seen.sharp_pixels;
            }
        SilhouetteRays rays;
        read_silhouette(camera, seen, {}, rays, {pixels.data(), kWidth, kHeight, 1, kWidth});
        return rays;
    };
    for (const auto& [background, clothes] : {std::pair{100, 160}, std::pair{100, 60}, std::pair{20, 26}}) {
        const SilhouetteRays rays = rays_in(background, clothes);
        const ContourRays& contour = rays.contour;
        EXPECT_GT(contour.size(), 90u) << clothes;
        EXPECT_TRUE(std::ranges::all_of(contour.outward[0], [](float x) { return x < 0.9f; })) << clothes;
        EXPECT_TRUE(std::ranges::any_of(contour.outward[0], [](float x) { return x < -0.9f; })) << clothes;
        EXPECT_TRUE(rays.is_nearest_to_border_without_contrast({125, 75})) << clothes;
        EXPECT_FALSE(rays.is_nearest_to_border_without_contrast({55, 75})) << clothes;
    }
}

TEST(PixelList, FindsDistanceToNearestPointUpToLimit) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> within(0, 300), around(-100, 400), limit(0, 3000);
    for (const int count : {1, 7, 8, 150}) {
        std::vector<Vec2> points(count);
        for (Vec2& point : points) point = {within(random), within(random)};
        PixelList list;
        list.assign(points);
        for (int n = 0; n < 200; ++n) {
            const Vec2 pixel{around(random), around(random)};
            double nearest = 1e9;
            for (const Vec2& point : points)
                nearest = std::min(nearest, std::pow(point.x - pixel.x, 2) + std::pow(point.y - pixel.y, 2));
            EXPECT_NEAR(list.squared_distance(pixel), nearest, 1e-4 * nearest + 1e-3);
            const float max = static_cast<float>(limit(random));
            EXPECT_NEAR(list.squared_distance(pixel, max), std::min<double>(nearest, max),
                        1e-4 * nearest + 1e-3);
        }
    }
    EXPECT_EQ(PixelList{}.squared_distance({1, 2}), std::numeric_limits<float>::infinity());
}

// rad: the left foot out, the right foot in.
constexpr double kTurnL = 0.3, kTurnR = 0.2;

BodyPosture with_turned_feet(const BodyPosture& straight) {
    BodyPosture turned = straight;
    add_foot_turn(kTurnL, kFootL, turned);
    add_foot_turn(kTurnR, kFootR, turned);
    return turned;
}

TEST(TurnFeet, FindsFeetTurnedInAndOut) {
    const Scene scene;
    const BodyPosture straight = posture_from_coordinates(scene.standing());
    const BodyPosture turned = with_turned_feet(straight);
    EXPECT_NEAR(foot_turn(turned, kFootL), kTurnL, 1e-9);
    const auto views = scene.see(turned);
    PoseCost cost;
    BodyPosture found = straight;
    turn_feet(*scene.model, views, 0.04, 4, cost, found);
    EXPECT_NEAR(foot_turn(found, kFootL), kTurnL, 0.08);
    EXPECT_NEAR(foot_turn(found, kFootR), kTurnR, 0.08);
    for (const int segment : {kPelvis, kShankL, kShankR})
        EXPECT_EQ(found.parent_from_segment[segment].m, straight.parent_from_segment[segment].m);
    const auto coordinates = coordinates_from_posture(found), before = coordinates_from_posture(straight);
    for (int k = 0; k < kBodyDofCount; ++k) EXPECT_NEAR(coordinates[k], before[k], 0.02) << k;
}

// The hips turn the legs, too.
TEST(PoseTracker, FindsTurnedFeet) {
    const Scene scene;
    const BodyPosture truth = with_turned_feet(posture_from_coordinates(scene.standing()));
    const auto views = scene.see(truth);
    PoseTracker tracker(30);
    tracker.set_model(scene.model);
    std::optional<TrackedPosture> tracked;
    for (int n = 0; n < 10; ++n) tracked = tracker.update(n * 33'333'333ll, views, {0, 0, 0.95}, {});
    ASSERT_TRUE(tracked.has_value());
    const JointPositions found = scene.model->forward(tracked->fit.posture).joints_in_world,
                         expected = scene.model->forward(truth).joints_in_world;
    for (const char* toe : {"toe_l", "toe_r"})
        EXPECT_LT(norm(found[*joint_index(toe)] - expected[*joint_index(toe)]), 0.015) << toe;
    EXPECT_GT(foot_turn(tracked->fit.posture, kFootL), 0.5 * kTurnL);
}

TEST(PoseTracker, FindsBodyWithoutPrior) {
    const Scene scene;
    const BodyCoordinates truth = scene.standing();
    const auto views = scene.see(truth);
    PoseTracker tracker(30);
    tracker.set_model(scene.model);
    const auto tracked = tracker.update(0, views, {0, 0, 0.95}, {});
    ASSERT_TRUE(tracked.has_value());
    EXPECT_LT(scene.error_m(tracked->fit.posture, truth), 0.03) << "left and right are not confused";
}

// Limbs are straight at the start: front and back look the same.
TEST(PoseTracker, TurnsABodyThatStartedTheWrongWay) {
    const Scene scene;
    constexpr double kFps = 25;
    BodyCoordinates truth = scene.standing();
    truth[5] = radians(180);  // the only heading that the tracker tries is 0
    truth[kDofKneeL] = truth[kDofHipL] = truth[kDofShoulderR] = truth[kDofElbowR] = 0;
    truth[kDofShoulderR + 1] = radians(-35);
    PoseTracker tracker(kFps, {.headings = 1, .starts = 1, .hypotheses = 1, .always_search_limbs = true});
    tracker.set_model(scene.model);
    std::optional<TrackedPosture> tracked;
    for (int n = 0; n < 30; ++n) {
        truth[kDofKneeL] = radians(3 * n), truth[kDofHipL] = radians(2 * n);
        tracked = tracker.update(n * 40'000'000LL, scene.see(truth), {0, 0, 0.95}, {});
        if (n == 0) {
            ASSERT_TRUE(tracked.has_value());
            EXPECT_GT(scene.error_m(tracked->fit.posture, truth), 0.1) << "the start is the wrong one";
        }
    }
    ASSERT_TRUE(tracked.has_value());
    EXPECT_LT(scene.error_m(tracked->fit.posture, truth), 0.03);
}

// Later frame sets cannot correct what was sent.
TEST(PoseTracker, LiveTurnsABodyInItsFirstFrameSet) {
    const Scene scene;
    BodyCoordinates truth = scene.standing();
    truth[5] = radians(180);  // the only heading that the tracker tries is 0
    PoseTracker tracker(30, {.headings = 1, .starts = 1, .hypotheses = 1});
    tracker.set_model(scene.model);
    const auto tracked = tracker.update(0, scene.see(truth), {0, 0, 0.95}, {});
    ASSERT_TRUE(tracked.has_value());
    EXPECT_LT(scene.error_m(tracked->fit.posture, truth), 0.03);
}

TEST(PoseTracker, LiveConsidersTheBodyThatFacesTheOtherWay) {
    const Scene scene;
    const BodyCoordinates truth = scene.standing();
    const BodyCoordinates other =
        coordinates_from_posture(turned(*scene.model, posture_from_coordinates(truth)));
    for (const bool live : {true, false}) {
        PoseTracker tracker(30, {.always_search_limbs = !live});
        tracker.set_model(scene.model);
        const auto tracked = tracker.update(0, scene.see(truth), {0, 0, 0.95}, {});
        ASSERT_TRUE(tracked.has_value());
        EXPECT_EQ(std::ranges::count_if(tracked->around,
                                        [&](const JudgedPosture& reading) {
                                            return scene.error_m(reading.posture, other) < 0.06 &&
                                                   reading.cost_above > 0;
                                        }),
                  live);
    }
}

// The limbs that no search finds may be others', but not a whole body.
TEST(PoseTracker, LiveFindsABodyAgainAmongOthersWhereItExplainsLittle) {
    const Scene scene;
    const BodyPosture upright = posture_from_coordinates(scene.standing());
    BodyPosture upside_down = upright;
    const Mat3 half_turn = rotation_from_rodrigues({std::numbers::pi, 0, 0});
    upside_down.root_in_world = Vec3{0, 0, 1.9} + half_turn * upright.root_in_world;
    upside_down.parent_from_segment[kPelvis] = half_turn * upright.parent_from_segment[kPelvis];
    const auto see_beside_others = [&](const BodyPosture& posture) {
        std::vector<SilhouetteRays> views(scene.cameras.size());
        std::vector<BodyCapsule> capsules;
        scene.model->capsules(scene.model->forward(posture), capsules);
        for (std::size_t c = 0; c < views.size(); ++c) {
            const kernels::Silhouettes own = testing::silhouette_of(scene.cameras[c], capsules);
            ForegroundPart shared{std::vector<std::uint8_t>(own.sharp.size(), 0), {0, 0, 20, 20}};
            for (int y = 0; y < 20; ++y) std::fill_n(shared.mask.begin() + y * own.width, 20, 255);
            read_silhouette(scene.cameras[c], own, {}, views[c], {}, &shared);
        }
        return views;
    };
    PoseTracker tracker(30);
    tracker.set_model(scene.model);
    const PoseCandidate start{.coordinates = coordinates_from_posture(upside_down)};
    auto tracked = tracker.update(0, see_beside_others(upside_down), {0, 0, 0.95}, {&start, 1});
    ASSERT_TRUE(tracked.has_value());
    ASSERT_LT(scene.error_m(tracked->fit.posture, coordinates_from_posture(upside_down)), 0.05);
    const auto views = see_beside_others(upright);
    for (int n = 1; n < 10; ++n) tracked = tracker.update(n * 33'333'333LL, views, {0, 0, 0.95}, {});
    ASSERT_TRUE(tracked.has_value());
    EXPECT_LT(scene.error_m(tracked->fit.posture, scene.standing()), 0.03);
}

TEST(TurnedPosture, FacesTheOtherWayAndKeepsTheEndsOfLimbs) {
    const Scene scene;
    const BodyPosture posture = posture_from_coordinates(scene.standing());
    const BodyPosture other = turned(*scene.model, posture);
    const PosedBody before = scene.model->forward(posture), after = scene.model->forward(other);
    const auto forward = [](const PosedBody& body, int segment) {
        return body.world_from_segment[segment].rotation * Vec3{1, 0, 0};
    };
    EXPECT_LT(dot(forward(before, kPelvis), forward(after, kPelvis)), -0.99);
    EXPECT_LT(dot(forward(before, kHead), forward(after, kHead)), -0.99);
    for (const auto& [name, opposite] : {std::pair{"wrist_l", "wrist_r"}, std::pair{"elbow_r", "elbow_l"},
                                         std::pair{"ankle_l", "ankle_r"}, std::pair{"hip_r", "hip_l"}})
        EXPECT_LT(
            norm(before.joints_in_world[*joint_index(name)] - after.joints_in_world[*joint_index(opposite)]),
            0.07)
            << name;  // the shoulders' centres are not on the long axis
    const BodyCoordinates q = coordinates_from_posture(other);
    EXPECT_NEAR(q[kDofKneeR], radians(35), 1e-6) << "the knee bends as far, to the other side";
}

TEST(TurnedPosture, MirrorsAnElbowAndKeepsTheWrist) {
    const Scene scene;
    const BodyPosture posture = posture_from_coordinates(scene.standing());
    const BodyPosture mirrored = elbow_mirrored(*scene.model, posture, kUpperArmR);
    const PosedBody before = scene.model->forward(posture), after = scene.model->forward(mirrored);
    EXPECT_LT(norm(before.joints_in_world[*joint_index("wrist_r")] -
                   after.joints_in_world[*joint_index("wrist_r")]),
              0.03);  // the shoulder's centre moves with the arm
    EXPECT_GT(norm(before.joints_in_world[*joint_index("elbow_r")] -
                   after.joints_in_world[*joint_index("elbow_r")]),
              0.2);
    EXPECT_LT(std::abs(upper_arm_twist(posture, kUpperArmR)), radians(30));
    EXPECT_GT(std::abs(upper_arm_twist(mirrored, kUpperArmR)), radians(120));
}

// Both silhouettes and motion allow it for a while.
TEST(PoseTracker, MovesAMirroredElbowToItsSide) {
    const Scene scene;
    BodyCoordinates truth = scene.standing();
    truth[kDofElbowL] = radians(30);
    const auto views = scene.see(truth);
    PoseTracker tracker(30);
    tracker.set_model(scene.model);
    BodyCoordinates start =
        coordinates_from_posture(elbow_mirrored(*scene.model, posture_from_coordinates(truth), kUpperArmL));
    const PoseCandidate wrong{.coordinates = start};
    std::optional<TrackedPosture> tracked;
    for (int n = 0; n < 8; ++n) tracked = tracker.update(n * 33'333'333LL, views, {0, 0, 0.95}, {&wrong, 1});
    ASSERT_TRUE(tracked.has_value());
    EXPECT_LT(std::abs(upper_arm_twist(tracked->fit.posture, kUpperArmL)), radians(40));
    EXPECT_LT(scene.error_m(tracked->fit.posture, truth), 0.013);
}

TEST(PoseTracker, FindsLyingBodyWithoutPrior) {
    const Scene scene;
    for (const double tilt : {90.0, -90.0}) {
        BodyCoordinates truth = scene.standing();
        truth[kDofRootRotation] = radians(tilt);
        truth[kDofRootRotation + 2] = radians(50);
        truth[kDofShoulderR] = 0, truth[kDofElbowR] = radians(20);  // not into the floor
        truth = centred(*scene.model, truth, {0, 0, 0.16});
        PoseTracker tracker(30);
        tracker.set_model(scene.model);
        const auto tracked = tracker.update(0, scene.see(truth), {0, 0, 0.16}, {});
        ASSERT_TRUE(tracked.has_value());
        EXPECT_LT(scene.error_m(tracked->fit.posture, truth), 0.07) << "tilt " << tilt;
    }
}

// One arm forward and one backward or beside the trunk, where neither covers much of the silhouettes' border.
TEST(PoseTracker, FindsArmsInFirstFrameSet) {
    const Scene scene;
    std::vector<std::string> wrong;
    for (const double forward : {30.0, 60.0, 90.0})
        for (const double other : {-40.0, -20.0, 0.0})
            for (const double elbow : {5.0, 40.0, 90.0})
                for (const bool left : {false, true}) {
                    BodyCoordinates truth = scene.standing();
                    truth[kDofShoulderL + 1] = 0;
                    truth[kDofShoulderL] = radians(left ? forward : other);
                    truth[kDofShoulderR] = radians(left ? other : forward);
                    truth[kDofElbowL] = truth[kDofElbowR] = radians(elbow);
                    PoseTracker tracker(30);
                    tracker.set_model(scene.model);
                    const auto tracked = tracker.update(0, scene.see(truth), {0, 0, 0.95}, {});
                    ASSERT_TRUE(tracked.has_value());
                    if (scene.error_m(tracked->fit.posture, truth) > 0.03)
                        wrong.push_back(fmt::format("{} arm {} deg forward, the other {}, elbows {}",
                                                    left ? "left" : "right", forward, other, elbow));
                }
    EXPECT_LE(wrong.size(), 1u) << fmt::format("{}", fmt::join(wrong, "\n"));
}

TEST(PoseTracker, FollowsArmsThatMoveFarBetweenFrameSets) {
    const Scene scene;
    constexpr double kFps = 10;
    PoseTracker tracker(kFps);
    tracker.set_model(scene.model);
    BodyCoordinates truth = scene.standing();
    for (int n = 0; n < 12; ++n) {
        // Both arms swing against each other, by up to 120 degrees from frame set to frame set.
        const bool forwards = n % 2 == 0;
        truth[kDofShoulderL] = radians(forwards ? 85 : -35);
        truth[kDofShoulderR] = radians(forwards ? -35 : 85);
        const auto time_ns = static_cast<std::int64_t>(n * 1e9 / kFps);
        const auto tracked = tracker.update(time_ns, scene.see(truth), {0, 0, 0.95}, {});
        ASSERT_TRUE(tracked.has_value()) << "frame set " << n;
        EXPECT_LT(scene.error_m(tracked->fit.posture, truth), 0.03) << "frame set " << n;
    }
}

TEST(PoseTracker, FollowsArmsThatPassEachOtherBetweenFrameSets) {
    const Scene scene;
    PoseTracker tracker(30);
    tracker.set_model(scene.model);
    BodyCoordinates truth = scene.standing();
    for (int n = 0; n < 45; ++n) {
        truth[kDofShoulderL + 1] = 0;
        const bool passed = n >= 40;  // after the first second, in which every search is tried
        truth[kDofShoulderL] = radians(passed ? 60 : -30), truth[kDofShoulderR] = radians(passed ? -30 : 60);
        truth[kDofElbowL] = truth[kDofElbowR] = radians(40);
        const auto tracked = tracker.update(n * 33'333'333LL, scene.see(truth), {0, 0, 0.95}, {});
        ASSERT_TRUE(tracked.has_value()) << "frame set " << n;
        EXPECT_LT(scene.error_m(tracked->fit.posture, truth), 0.03) << "frame set " << n;
    }
}

// After the first second, in which every search is tried. A forearm is 2 % of the contour: too little to
// lower the explained fraction noticeably.
TEST(PoseTracker, FindsForearmThatLeavesTheBody) {
    const Scene scene;
    PoseTracker tracker(30);
    tracker.set_model(scene.model);
    BodyCoordinates truth = scene.standing();
    truth[kDofShoulderL] = 0, truth[kDofElbowL] = radians(150);
    for (int n = 0; n < 48; ++n) {
        if (n >= 45) truth[kDofShoulderL] = radians(70), truth[kDofElbowL] = radians(5);
        const auto tracked = tracker.update(n * 33'333'333LL, scene.see(truth), {0, 0, 0.95}, {});
        ASSERT_TRUE(tracked.has_value()) << "frame set " << n;
        EXPECT_LT(scene.error_m(tracked->fit.posture, truth), 0.03) << "frame set " << n;
    }
}

TEST(PoseTracker, FindsArmAndLegThatMovedFarWhileFrameSetsWereLost) {
    const Scene scene;
    PoseTracker tracker(30);
    tracker.set_model(scene.model);
    BodyCoordinates truth = scene.standing();
    std::int64_t time_ns = 0;
    for (int n = 0; n < 45; ++n, time_ns += 33'333'333)
        ASSERT_TRUE(tracker.update(time_ns, scene.see(truth), {0, 0, 0.95}, {}).has_value());
    time_ns += 300'000'000;
    truth[kDofHipR] = radians(80), truth[kDofKneeR] = radians(60);
    truth[kDofShoulderR] = radians(100), truth[kDofElbowR] = radians(20);
    truth[kDofShoulderL] = radians(-40);
    const auto tracked = tracker.update(time_ns, scene.see(truth), {0, 0, 0.95}, {});
    ASSERT_TRUE(tracked.has_value());
    EXPECT_LT(scene.error_m(tracked->fit.posture, truth), 0.03);
}

// Searches of limbs alone do not find them. The processor is too slow for all frame sets, so there is no
// search of everything either.
TEST(PoseTracker, FindsBodyThatTurnsAndLungesWhileMostFrameSetsAreLost) {
    const Scene scene;
    PoseTracker tracker(30);
    tracker.set_model(scene.model);
    BodyCoordinates truth = scene.standing();
    for (int n = 0; n < 12; ++n) {
        if (n == 10) {
            truth[5] += radians(110), truth[2] -= 0.15;
            truth[kDofHipR] = radians(80), truth[kDofKneeR] = radians(70), truth[kDofHipL] = radians(-20);
            truth[kDofShoulderR] = radians(100), truth[kDofShoulderL] = radians(-40);
        }
        const auto tracked = tracker.update(n * 180'000'000LL, scene.see(truth), {0, 0, 0.9}, {});
        ASSERT_TRUE(tracked.has_value()) << "frame set " << n;
        EXPECT_LT(scene.error_m(tracked->fit.posture, truth), 0.03) << "frame set " << n;
    }
}

TEST(Retrack, FollowsLimbsThatMoveFarBetweenFrameSets) {
    const Scene scene;
    constexpr double kFps = 10;
    std::vector<BodyCoordinates> truth;
    std::vector<PoseObservation> seen;
    for (int n = 0; n < 12; ++n) {
        BodyCoordinates q = scene.standing();
        q[kDofShoulderL] = radians(n % 2 == 0 ? 85 : -35);
        q[kDofShoulderR] = radians(n % 2 == 0 ? -35 : 85);
        truth.push_back(q);
        seen.push_back({static_cast<std::int64_t>(n * 1e9 / kFps), {0, 0, 0.95}, scene.see(q)});
    }
    std::vector<RecordedView> views;
    for (const PoseObservation& frame : seen) views.push_back({1, views.size(), &frame});
    views[5].seen = nullptr;  // no subject
    PoseStageOptions options;
    options.body = scene.model->shape();
    const auto frames = retrack(scene.cameras, kFps, views, options);
    for (std::size_t n = 0; n < frames.size(); ++n) {
        ASSERT_EQ(frames[n].posture.has_value(), n != 5) << "frame set " << n;
        if (n == 5) continue;
        EXPECT_LT(scene.error_m(*frames[n].posture, truth[n]), 0.03) << "frame set " << n;
        EXPECT_EQ(frames[n].pose->sequence, n);
        EXPECT_GT(frames[n].probability, 0.5);
    }
}

// One arm raised, the other bent in front; both of the model's arms lie in the raised one.
TEST(LimbSearch, SeparatesCoincidingArms) {
    const Scene scene;
    BodyCoordinates truth = scene.standing();
    truth[kDofShoulderL] = radians(80), truth[kDofShoulderL + 1] = 0, truth[kDofElbowL] = radians(10);
    truth[kDofShoulderR] = radians(-30), truth[kDofShoulderR + 1] = radians(-30),
    truth[kDofElbowR] = radians(100);
    const auto views = scene.see(truth);
    BodyCoordinates start = truth;
    start[kDofShoulderR] = radians(80), start[kDofShoulderR + 1] = radians(30),
    start[kDofElbowR] = radians(10);
    start[kDofShoulderL] = radians(20), start[kDofElbowL] = radians(90);
    LimbSearch search;
    PoseFitter fitter;
    std::optional<PoseFit> best;
    for (const auto& [first, second] :
         {std::pair{Limb::kArmL, Limb::kArmR}, std::pair{Limb::kArmR, Limb::kArmL}}) {
        const auto moved =
            search.improve_pair(*scene.model, posture_from_coordinates(start), views, first, second, 0.08);
        ASSERT_TRUE(moved.has_value());
        PoseFit fit = fitter.fit(*scene.model, views, *moved, nullptr, true);
        if (!best || fit.at.cost < best->at.cost) best = std::move(fit);
    }
    EXPECT_LT(scene.error_m(best->posture, truth), 0.02) << "in one of the two orders";
    EXPECT_GT(
        scene.error_m(fitter.fit(*scene.model, views, posture_from_coordinates(start), nullptr, true).posture,
                      truth),
        0.05)
        << "local optimisation alone does not converge";
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

TEST(MainBody, KeepsLegsAndExcludesChair) {
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
    const Camera& camera = scene.cameras[0];
    kernels::Silhouettes empty;
    empty.width = camera.width, empty.height = camera.height;
    empty.sharp.assign(camera.width * camera.height, 0);
    read_silhouette(camera, empty, {}, views[0]);
    EXPECT_EQ(views[0].camera, nullptr);
}

TEST(PoseTracker, FullSilhouettesGiveNoPose) {
    const Scene scene;
    const Camera& camera = scene.cameras[0];
    kernels::Silhouettes full;
    full.width = camera.width, full.height = camera.height;
    full.sharp.assign(camera.width * camera.height, 255);
    full.sharp_pixels = camera.width * camera.height;
    full.bounds = {0, 0, camera.width, camera.height};
    std::vector<SilhouetteRays> views(scene.cameras.size());
    for (std::size_t c = 0; c < views.size(); ++c) read_silhouette(scene.cameras[c], full, {}, views[c]);
    EXPECT_EQ(views[0].contour.size(), 0u) << "the image's edge is no border";
    PoseTracker tracker(30);
    for (int frame = 0; frame < 8; ++frame)
        EXPECT_FALSE(tracker.update(frame * 33'000'000LL, views, {0, 0, 1}, {}).has_value());
}

BodyPose judged_by(std::span<const SilhouetteRays> views, const Scene& scene, const BodyPosture& posture,
                   std::span<const WeightedPosture> others) {
    PoseCost cost;
    Linearisation data;
    cost.linearise(*scene.model, posture, views, nullptr, 0.04, data);
    BodyPose pose;
    judge_posture(*scene.model, posture, data, views, cost.terms(), cost.capsules(), others, 4, {}, pose);
    return pose;
}

TEST(PoseEstimate, WithholdsJointsThatNoCameraShows) {
    Scene scene;
    const BodyCoordinates truth = scene.standing();
    std::vector<BodyCapsule> capsules;
    scene.model->capsules(scene.model->forward(truth), capsules);
    std::vector<SilhouetteRays> views(scene.cameras.size());
    for (std::size_t c = 0; c < views.size(); ++c) {
        Camera& camera = scene.cameras[c];
        camera.height = 120;  // the legs lie below the image
        read_silhouette(camera, testing::silhouette_of(camera, capsules), {}, views[c]);
    }
    const BodyPosture posture = posture_from_coordinates(truth);
    BodyPose pose = judged_by(views, scene, posture, {});
    describe_posture(*scene.model, posture, pose);
    const JointEstimate &ankle = pose.joints[*joint_index("ankle_l")],
                        &shoulder = pose.joints[*joint_index("shoulder_l")];
    EXPECT_FALSE(ankle.measured());
    EXPECT_TRUE(std::isnan(ankle.in_world.x));
    EXPECT_TRUE(shoulder.measured()) << shoulder.withheld_reason;
    EXPECT_GT(ankle.std_m, 3 * shoulder.std_m);
    EXPECT_FALSE(pose.angles[*angle_index("knee_flexion_geometric_l")].measured());
    EXPECT_EQ(shoulder.camera_count, 4);
}

// With another subject in a corner of the images, or alone.
BodyPose judged_beside(const Scene& scene, const BodyPosture& posture,
                       const std::vector<BodyCapsule>& capsules, bool others) {
    std::vector<SilhouetteRays> views(scene.cameras.size());
    for (std::size_t c = 0; c < views.size(); ++c) {
        const kernels::Silhouettes seen = testing::silhouette_of(scene.cameras[c], capsules);
        ForegroundPart other{std::vector<std::uint8_t>(seen.sharp.size(), 0), {0, 0, 8, 8}};
        std::fill_n(other.mask.begin(), 8, 255);
        read_silhouette(scene.cameras[c], seen, {}, views[c], {}, others ? &other : nullptr);
    }
    return judged_by(views, scene, posture, {});
}

TEST(PoseEstimate, WithholdsBesideOthersWhatOneCameraShows) {
    Scene scene;
    const BodyPosture posture = posture_from_coordinates(scene.standing());
    std::vector<BodyCapsule> capsules;
    scene.model->capsules(scene.model->forward(posture), capsules);
    for (std::size_t c = 1; c < scene.cameras.size(); ++c)
        scene.cameras[c].height = 120;  // the legs lie below the image
    for (const bool beside_others : {false, true}) {
        const BodyPose pose = judged_beside(scene, posture, capsules, beside_others);
        const JointEstimate& ankle = pose.joints[*joint_index("ankle_l")];
        const AngleEstimate& knee = pose.angles[*angle_index("knee_flexion_geometric_l")];
        EXPECT_EQ(ankle.camera_count, 1);
        EXPECT_EQ(ankle.withheld_reason, beside_others ? "joint visible in one of 4 cameras" : "");
        EXPECT_EQ(knee.measured(), !beside_others) << knee.withheld_reason;
        EXPECT_TRUE(pose.joints[*joint_index("shoulder_l")].measured());
    }
}

TEST(PoseEstimate, WithholdsLimbsBesideOthersWhereLittleIsVisible) {
    Scene scene;
    const BodyPosture posture = posture_from_coordinates(scene.standing());
    std::vector<BodyCapsule> capsules;
    scene.model->capsules(scene.model->forward(posture), capsules);
    for (Camera& camera : scene.cameras) camera.height = 105;  // legs and hands lie below the image
    for (const bool beside_others : {false, true}) {
        const BodyPose pose = judged_beside(scene, posture, capsules, beside_others);
        for (const char* name : {"knee_l", "ankle_r", "toe_l"})
            EXPECT_FALSE(pose.joints[*joint_index(name)].measured()) << name;
        const JointEstimate& elbow = pose.joints[*joint_index("elbow_l")];
        EXPECT_EQ(elbow.measured(), !beside_others) << elbow.withheld_reason;
        EXPECT_FALSE(beside_others && pose.angles[*angle_index("shoulder_elevation_geometric_l")].measured());
        EXPECT_TRUE(pose.joints[*joint_index("shoulder_l")].measured());
        EXPECT_TRUE(pose.angles[*angle_index("trunk_lean_geometric")].measured());
    }
}

// Of the standing body, seen by all cameras.
BodyPose judged(const Scene& scene, const BodyPosture& posture, std::span<const WeightedPosture> others) {
    return judged_by(scene.see(scene.standing()), scene, posture, others);
}

// Silhouettes do not show where joint centres are inside a body.
TEST(PoseEstimate, StatesErrorOfModelWhereSilhouettesFit) {
    const Scene scene;
    const BodyPose pose = judged(scene, posture_from_coordinates(scene.standing()), {});
    const auto std_m = [&](const char* joint) { return pose.joints[*joint_index(joint)].std_m; };
    EXPECT_GT(std_m("wrist_l"), 0.0075);
    EXPECT_GT(std_m("toe_r"), 0.005);
    for (std::size_t j = 0; j < pose.joints.size(); ++j)
        EXPECT_LT(pose.joints[j].std_m, 0.02) << kJointNames[j];
}

TEST(PoseEstimate, WidensTopOfHeadThatMisfits) {
    const Scene scene;
    BodyCoordinates bent = scene.standing();
    bent[kDofSkullbase] -= radians(30);
    const BodyPose right = judged(scene, posture_from_coordinates(scene.standing()), {}),
                   wrong = judged(scene, posture_from_coordinates(bent), {});
    const auto wider = [&](const char* joint) {
        return wrong.joints[*joint_index(joint)].std_m / right.joints[*joint_index(joint)].std_m;
    };
    EXPECT_GT(wider("head_top"), 1.5);
    EXPECT_LT(wider("skullbase"), 1.3);
}

TEST(PoseStage, StatesLargerDeviationsUntilTheBodyIsKnown) {
    const Scene scene;
    const PoseObservation seen{0, {0, 0, 0.95}, scene.see(scene.standing())};
    PoseStage stage(scene.cameras, 30, {.filtered = false, .body = scene.model->shape()});
    const auto unknown = stage.process(1, 0, 0, seen, {});
    stage.set_body({.shape = scene.model->shape()});
    stage.reset();
    const auto known = stage.process(1, 1, 0, seen, {});
    ASSERT_TRUE(unknown && known);
    for (const char* name : {"root", "knee_l", "wrist_r"}) {
        const std::size_t j = *joint_index(name);
        EXPECT_GT(unknown->joints[j].std_m, 0.018) << name;
        EXPECT_LT(known->joints[j].std_m, 0.016) << name;
    }
    const std::size_t top = *joint_index("head_top");
    EXPECT_GT(unknown->joints[top].std_m, known->joints[top].std_m + 0.015) << "a wrong body bends its neck";
    EXPECT_GT(unknown->angles[0].std_rad, known->angles[0].std_rad + radians(0.5));
    EXPECT_GT(unknown->coordinate_std[kDofKneeL], known->coordinate_std[kDofKneeL] + radians(0.5));
}

TEST(PoseEstimate, WidensJointsThatAnotherPostureContradicts) {
    const Scene scene;
    BodyCoordinates other = scene.standing();
    other[kDofElbowL] += radians(60);
    const BodyPosture posture = posture_from_coordinates(scene.standing());
    const WeightedPosture others[] = {{posture, 0.6}, {posture_from_coordinates(other), 0.4}};
    const BodyPose certain = judged(scene, posture, {}), doubtful = judged(scene, posture, others);
    const auto std_m = [](const BodyPose& pose, const char* joint) {
        return pose.joints[*joint_index(joint)].std_m;
    };
    EXPECT_GT(std_m(doubtful, "wrist_l"), 4 * std_m(certain, "wrist_l"));
    EXPECT_EQ(std_m(doubtful, "wrist_r"), std_m(certain, "wrist_r"));
    EXPECT_GT(doubtful.angles[*angle_index("elbow_flexion_geometric_l")].std_rad,
              2 * certain.angles[*angle_index("elbow_flexion_geometric_l")].std_rad);
}

// The foot of a folded leg may touch other contours; there is no gross error of the ankle's own.
TEST(PoseEstimate, WidensJointThatHangsFromALostOne) {
    const Scene scene;
    BodyCoordinates folded = scene.standing();
    folded[kDofHipR] += radians(60), folded[kDofKneeR] += radians(120);
    const BodyPose pose = judged(scene, posture_from_coordinates(folded), {});
    const auto std_m = [&](const char* joint) { return pose.joints[*joint_index(joint)].std_m; };
    EXPECT_GT(std_m("knee_r"), 2 * std_m("knee_l"));
    EXPECT_GE(std_m("ankle_r"), std_m("knee_r"));
}

// No later frame set corrects a lost limb.
TEST(PoseStage, StatesLargerDeviationsLiveThanOfARecording) {
    const Scene scene;
    const PoseObservation seen{0, {0, 0, 0.95}, scene.see(scene.standing())};
    std::array<std::shared_ptr<BodyPose>, 2> poses;
    for (const bool live : {false, true}) {
        PoseStageOptions options{.filtered = live};
        options.set_body(scene.model->shape());
        poses[live] = PoseStage(scene.cameras, 30, options).process(1, 0, 0, seen, {});
        ASSERT_TRUE(poses[live]);
    }
    for (const char* name : {"elbow_l", "wrist_r", "hand_l"})
        EXPECT_GT(poses[true]->joints[*joint_index(name)].std_m,
                  poses[false]->joints[*joint_index(name)].std_m)
            << name;
}

// The first posture is found in one frame set; later ones confirm it.
TEST(PoseStage, StatesLargerDeviationsOfANewPoseLive) {
    const testing::SeenBody scene;
    PoseStage stage(scene.cameras, 30, {.body = scene.model->shape()});
    const PoseObservation seen{0, {0, 0, 0.95}, scene.see(scene.standing())};
    std::shared_ptr<BodyPose> first, last;
    for (int n = 0; n < 45; ++n) {
        PoseObservation now = seen;
        now.time_ns = n * 33'333'333ll;
        last = stage.process(1, n, now.time_ns, now, {});
        ASSERT_TRUE(last);
        if (n == 0) first = last;
    }
    constexpr std::size_t kRoot = *joint_index("root");
    EXPECT_GT(first->joints[kRoot].std_m, 1.15 * last->joints[kRoot].std_m);
}

TEST(PoseEstimate, WidensLimbThatMissesItsSilhouettes) {
    const Scene scene;
    BodyCoordinates wrong = scene.standing();
    wrong[kDofElbowL] += radians(70);
    const BodyPose right = judged(scene, posture_from_coordinates(scene.standing()), {}),
                   misplaced = judged(scene, posture_from_coordinates(wrong), {});
    const auto wider = [&](const char* joint) {
        return misplaced.joints[*joint_index(joint)].std_m / right.joints[*joint_index(joint)].std_m;
    };
    EXPECT_GT(wider("wrist_l"), 2);
    EXPECT_GT(wider("wrist_l"), 1.5 * wider("ankle_r"));
}

TEST(PoseEstimate, WithholdsLegsThatAreFoldedInAFloatingBody) {
    const Scene scene;
    BodyCoordinates folded = scene.standing();
    folded[kDofHipL] = folded[kDofHipR] = radians(110), folded[kDofKneeL] = folded[kDofKneeR] = radians(140);
    const auto lacking = [&](const BodyCoordinates& posture, const BodyCoordinates& visible) {
        return see_legs(*scene.model, posture_from_coordinates(posture), scene.see(visible)).none();
    };
    EXPECT_TRUE(lacking(folded, folded));
    EXPECT_FALSE(lacking(scene.standing(), scene.standing()));
    EXPECT_TRUE(lacking(scene.standing(), folded)) << "legs outside the silhouettes";
    BodyCoordinates raised = scene.standing();
    raised[kDofHipL] = raised[kDofHipR] = radians(150);
    EXPECT_TRUE(lacking(raised, raised));
    folded[2] = 0.4;  // squatting
    EXPECT_FALSE(lacking(folded, folded));
    BodyPose pose = judged(scene, posture_from_coordinates(scene.standing()), {});
    withhold_legs({true, true}, pose);
    for (const char* joint : {"hip_l", "knee_r", "ankle_l", "toe_r"})
        EXPECT_FALSE(pose.joints[*joint_index(joint)].measured()) << joint;
    EXPECT_TRUE(pose.joints[*joint_index("wrist_l")].measured());
    EXPECT_FALSE(pose.angles[*angle_index("knee_flexion_geometric_l")].measured());
    EXPECT_TRUE(pose.angles[*angle_index("elbow_flexion_geometric_l")].measured());
}

TEST(PoseEstimate, WithholdsOnlyTheMissingLeg) {
    const Scene scene;
    BodyPose pose = judged(scene, posture_from_coordinates(scene.standing()), {});
    withhold_legs({true, false}, pose);
    EXPECT_FALSE(pose.joints[*joint_index("knee_l")].measured());
    EXPECT_TRUE(pose.joints[*joint_index("knee_r")].measured());
}

std::vector<double> tenths(std::size_t count) {
    std::vector<double> time_s;
    for (std::size_t n = 0; n < count; ++n) time_s.push_back(0.1 * static_cast<double>(n));
    return time_s;
}

// Frame sets 100 ms apart: no legs for 1.5 s, the left one in frame set 5 alone, the right one from 15 on.
TEST(MissingLegs, EachReturnsAfterItIsSeenForLongEnough) {
    constexpr LegSight kNone{{true, true}, true}, kRight{{true, false}, false}, kLeft{{false, true}, false};
    std::vector<std::optional<LegSight>> sights(24, kNone);
    sights[5] = kLeft;
    std::fill(sights.begin() + 15, sights.end(), kRight);
    const std::vector<LegFlags> missing = missing_legs(sights, tenths(sights.size()));
    for (const std::size_t n : {0, 5, 14}) EXPECT_EQ(missing[n], (LegFlags{true, true})) << n;
    for (const std::size_t n : {15, 23}) EXPECT_EQ(missing[n], (LegFlags{true, false})) << n;
    MissingLegs live;
    std::vector<LegFlags> found;
    for (std::size_t n = 0; n < sights.size(); ++n)
        found.push_back(live.update(static_cast<std::int64_t>(n) * 100'000'000, *sights[n]));
    EXPECT_EQ(found[13], (LegFlags{false, false})) << "it may be a jump: a leg was seen .8 s ago";
    EXPECT_EQ(found[14], (LegFlags{true, true}));
    EXPECT_EQ(found[17], (LegFlags{true, true}));
    EXPECT_EQ(found[19], (LegFlags{true, false}));
}

TEST(MissingLegs, BelievesAFoldedLegOfABodyThatStands) {
    std::vector<std::optional<LegSight>> sights(24, LegSight{{true, false}, false});
    for (const LegFlags& missing : missing_legs(sights, tenths(sights.size())))
        EXPECT_EQ(missing, LegFlags{});
}

// A body without legs is seen for 1.5 s: longer than a jump.
TEST(Retrack, WithholdsLegsThatSilhouettesLack) {
    const Scene scene;
    BodyCoordinates folded = scene.standing();
    folded[kDofHipL] = folded[kDofHipR] = radians(115), folded[kDofKneeL] = folded[kDofKneeR] = radians(140);
    const PoseObservation frame{0, {0, 0, 1.1}, scene.see(folded)};
    std::vector<PoseObservation> seen(16, frame);
    std::vector<RecordedView> views;
    for (std::size_t n = 0; n < seen.size(); ++n) {
        seen[n].time_ns = static_cast<std::int64_t>(n) * 100'000'000;
        views.push_back({1, n, &seen[n]});
    }
    PoseStageOptions options;
    options.body = scene.model->shape();
    const auto frames = retrack(scene.cameras, 10, views, options);
    ASSERT_TRUE(frames[8].posture.has_value());
    ASSERT_TRUE(see_legs(*scene.model, *frames[8].posture, frame.views).none());
    EXPECT_FALSE(frames[8].pose->joints[*joint_index("knee_l")].measured());
    EXPECT_TRUE(frames[8].pose->joints[*joint_index("shoulder_l")].measured());
    PoseStage stage(scene.cameras, 10, options);
    std::shared_ptr<BodyPose> pose;
    for (std::size_t n = 0; n < seen.size(); ++n) {
        pose = stage.process(1, n, seen[n].time_ns, seen[n], {});
        ASSERT_TRUE(pose);
        if (n == 4) {
            EXPECT_TRUE(pose->joints[*joint_index("hip_l")].measured()) << "it may be a jump";
        }
    }
    EXPECT_FALSE(pose->joints[*joint_index("hip_l")].measured());
    EXPECT_FALSE(pose->joints[*joint_index("knee_l")].measured());
    PoseObservation standing{0, {0, 0, 1.1}, scene.see(scene.standing())};
    for (std::size_t n = 0; n < 10; ++n) {
        standing.time_ns = static_cast<std::int64_t>(seen.size() + n) * 100'000'000;
        pose = stage.process(1, seen.size() + n, standing.time_ns, standing, {});
        ASSERT_TRUE(pose);
        if (n < 3) {
            EXPECT_FALSE(pose->joints[*joint_index("knee_l")].measured()) << "they may appear briefly";
        }
    }
    EXPECT_TRUE(pose->joints[*joint_index("knee_l")].measured());
}

TEST(PostureFilter, ZeroPhasePreservesSlowMovement) {
    std::vector<std::optional<BodyPosture>> postures, noisy;
    for (int n = 0; n < 120; ++n) {
        BodyCoordinates q{};
        q[0] = 0.01 * n;
        q[kDofKneeL] = radians(40) + radians(30) * std::sin(0.08 * n);
        postures.emplace_back(posture_from_coordinates(q));
        q[kDofKneeL] += radians(4) * (n % 2 == 0 ? 1 : -1);
        noisy.emplace_back(posture_from_coordinates(q));
    }
    noisy[50].reset();
    smooth_zero_phase(noisy, 60, 6);
    EXPECT_FALSE(noisy[50].has_value());
    for (const int n : {10, 30, 70, 100}) {
        const double wanted = coordinates_from_posture(*postures[n])[kDofKneeL];
        EXPECT_NEAR(coordinates_from_posture(*noisy[n])[kDofKneeL], wanted, radians(0.7)) << n;
        EXPECT_NEAR(noisy[n]->root_in_world.x, 0.01 * n, 1e-4);
    }
}

TEST(PostureFilter, IsNotAppliedToFewSamplesPerPeriodOfCutoff) {
    EXPECT_EQ(applied_cutoff_hz(6, 25), 6);
    EXPECT_EQ(applied_cutoff_hz(6, 18), 6);
    EXPECT_EQ(applied_cutoff_hz(6, 15), 0);
    EXPECT_EQ(applied_cutoff_hz(3, 15), 3);
    EXPECT_EQ(applied_cutoff_hz(0, 15), 0);
}

TEST(PostureFilter, OneEuroFollowsTurnedFeet) {
    OneEuroPosture filter;
    const BodyPosture straight = posture_from_coordinates({});
    filter.filter(straight, 0);
    BodyPosture filtered;
    double before = 0;
    for (int n = 1; n <= 12; ++n) {
        filtered = filter.filter(with_turned_feet(straight), n * 16'666'667LL);
        EXPECT_GT(foot_turn(filtered, kFootL), before);
        before = foot_turn(filtered, kFootL);
        EXPECT_LT(before, n == 1 ? 0.8 * kTurnL : 1.01 * kTurnL) << "a single measurement is smoothed";
    }
    EXPECT_NEAR(foot_turn(filtered, kFootL), kTurnL, 0.01);
    EXPECT_NEAR(foot_turn(filtered, kFootR), kTurnR, 0.01);
}

TEST(PostureFilter, OneEuroSmoothsRestAndFollowsMovement) {
    OneEuroPosture filter;
    BodyCoordinates q{};
    double calm = 0;
    for (int n = 0; n < 60; ++n) {
        q[kDofElbowL] = radians(60) + radians(2) * (n % 2 == 0 ? 1 : -1);
        const double out = coordinates_from_posture(
            filter.filter(posture_from_coordinates(q), n * 16'666'667LL))[kDofElbowL];
        if (n > 30) calm = std::max(calm, std::abs(out - radians(60)));
    }
    EXPECT_LT(calm, radians(1.6));
    double lag = 0;
    for (int n = 60; n < 80; ++n) {
        q[kDofElbowL] += radians(3);
        lag = q[kDofElbowL] - coordinates_from_posture(
                                  filter.filter(posture_from_coordinates(q), n * 16'666'667LL))[kDofElbowL];
    }
    EXPECT_LT(std::abs(lag), radians(0.5)) << "a steady motion has no lag";
}

}  // namespace
}  // namespace kinevox
