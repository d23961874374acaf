// Boards, wands and bumped cameras of the virtual studio: the images match the ground truth.
#include "server/cameras/studio/staging.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "common/geometry.h"
#include "server/calibration/board/board_detector.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/wand/wand.h"
#include "server/cameras/studio/studio.h"

namespace kinevox::studio {
namespace {

StudioOptions empty_studio() {
    StudioOptions options;
    options.cameras = 3, options.width = 640, options.height = 480, options.fps = 10;
    options.distortion = 0.05;
    options.staging.person = false;
    return options;
}

double mean_residual_px(const BoardDetection& seen, const BoardSpec& board, const Camera& camera,
                        const Rigid3& world_from_board) {
    double sum = 0;
    for (const Corner& corner : seen.corners) {
        const auto truth = camera.project(world_from_board * board.points()[corner.id]);
        sum += std::hypot(truth->x - corner.pixel.x, truth->y - corner.pixel.y);
    }
    return sum / static_cast<double>(seen.corners.size());
}

TEST(Staging, BoardMatchesTruthUntilACameraIsBumped) {
    const BoardSpec board = *parse_board("charuco:6x5:160:120:DICT_4X4_100");
    auto detector = *BoardDetector::create(board);
    StudioOptions options = empty_studio();
    StagedBoard staged;
    staged.print.grey = detector->draw(staged.print.pixels_per_m, staged.print.origin_px);
    staged.centre_in_board = {0.48, 0.40, 0};
    staged.frames_on_floor = 2;
    options.staging.board = staged;
    options.staging.bump = CameraBump{1, 4, 1.0};
    auto studio = Studio::create(options);
    ASSERT_TRUE(studio.ok()) << studio.status();
    EXPECT_EQ((*studio)->world_from_target(1), (*studio)->world_from_target(0));
    const Vec3 corner{0.3, 0.2, 0};
    EXPECT_NEAR(((*studio)->world_from_target(1) * corner).z, 0, 1e-12);
    EXPECT_EQ((*studio)->camera_at(1, 39), (*studio)->cameras()[1]);
    EXPECT_NEAR(degrees(angle_between((*studio)->camera_at(1, 40).camera_from_world.rotation,
                                      (*studio)->cameras()[1].camera_from_world.rotation)),
                1, 1e-6);
    std::vector<int> seen_by(3, 0);
    bool moved_seen = false;
    for (const int frame : {0, 20, 45, 60, 75, 90, 105, 120, 135, 150}) {
        const std::vector<Image> images = (*studio)->draw(frame, false);
        for (std::size_t c = 0; c < 3; ++c) {
            const BoardDetection seen = detector->detect(images[c]);
            if (!seen.found()) continue;
            ++seen_by[c];
            const Rigid3 pose = (*studio)->world_from_target(frame);
            EXPECT_LT(mean_residual_px(seen, board, (*studio)->camera_at(c, frame), pose), 1.0)
                << c << " " << frame;
            if (c == 1 && frame >= 40) {
                moved_seen = true;
                EXPECT_GT(mean_residual_px(seen, board, (*studio)->cameras()[c], pose), 4);
            }
        }
    }
    EXPECT_THAT(seen_by, ::testing::Each(::testing::Ge(2)));
    EXPECT_TRUE(moved_seen);
    for (const auto& mask : (*studio)->masks(5))
        EXPECT_EQ(std::count(mask.begin(), mask.end(), 0), 640 * 480);
}

TEST(Staging, WandMatchesTruth) {
    for (const char* text : {"wand:200:600", "wand:500"}) {
        SCOPED_TRACE(text);
        const WandSpec wand = *parse_wand(text);
        StudioOptions options = empty_studio();
        options.staging.wand = StagedWand{};
        for (const Vec3 ball : wand.balls()) options.staging.wand->along_m.push_back(ball.x);
        auto studio = Studio::create(options);
        ASSERT_TRUE(studio.ok()) << studio.status();
        int found = 0;
        for (const int frame : {10, 30, 50, 70}) {
            const std::vector<Image> images = (*studio)->draw(frame, false);
            for (std::size_t c = 0; c < 3; ++c) {
                const WandDetection seen = detect_wand(images[c], (*studio)->draw_empty(c, 0), wand);
                if (!seen) continue;
                ++found;
                std::vector<Vec2> truth;
                for (const Vec3 ball : wand.balls())
                    truth.push_back(
                        *(*studio)->cameras()[c].project((*studio)->world_from_target(frame) * ball));
                const auto residual = [&](const std::vector<Vec2>& balls) {
                    double most = 0;
                    for (std::size_t k = 0; k < balls.size(); ++k)
                        most = std::max(most, std::hypot(truth[k].x - balls[k].x, truth[k].y - balls[k].y));
                    return most;
                };
                const double turned = truth.size() == 2 ? residual({(*seen)[1], (*seen)[0]}) : 1e9;
                EXPECT_LT(std::min(residual(*seen), turned), 1.0);
            }
        }
        EXPECT_GE(found, 8);
    }
}

TEST(Wand, FindsPermanentSceneChange) {
    std::vector<double> still(100, 0.002), bumped = still, visitor = still;
    for (int i = 60; i < 100; ++i) bumped[i] = 0.1;
    for (int i = 40; i < 80; ++i) visitor[i] = 0.1;
    bumped[20] = 0.2;
    EXPECT_EQ(first_permanent_change(still), -1);
    EXPECT_EQ(first_permanent_change(bumped), 60);
    EXPECT_EQ(first_permanent_change(visitor), -1);
    EXPECT_EQ(first_permanent_change(std::vector<double>(100, 0.1)), -1);
    EXPECT_EQ(first_permanent_change({}), -1);
}

TEST(Staging, RefusesInvalidStaging) {
    StudioOptions options = empty_studio();
    options.staging.bump = CameraBump{3, 1, 1};
    EXPECT_THAT(options.check(), ::testing::HasSubstr("camera 4"));
    options = empty_studio();
    options.staging.wand = StagedWand{{0}, 0.02};
    EXPECT_THAT(options.check(), ::testing::HasSubstr("two or three balls"));
}

// Two equal balls in random order, with some outliers: only their motion distinguishes them.
TEST(Wand, SolvesPosesFromTwoEqualBalls) {
    StudioOptions ring;
    ring.cameras = 5, ring.width = 1280, ring.height = 960, ring.distortion = 0.05;
    const std::vector<Camera> truth = ring_of_cameras(ring, false);
    std::vector<Camera> intrinsics = truth;
    for (Camera& camera : intrinsics) camera.camera_from_world = {};
    const WandSpec wand = *parse_wand("wand:600");
    Staging staging;
    staging.wand = StagedWand{{0, 0.6}, 0.02};
    WandProcedure procedure(intrinsics, wand);
    std::mt19937 random(5);
    std::normal_distribution<double> noise(0, 0.15);
    std::uniform_int_distribution<int> percent(0, 99);
    for (int m = 0; m < 240; ++m) {
        const Rigid3 pose = world_from_target(staging, truth, m, 15);
        for (int c = 0; c < 5; ++c) {
            std::vector<Vec2> seen;
            for (const Vec3 ball : wand.balls()) {
                const Vec2 pixel = *truth[c].project(pose * ball);
                seen.push_back({pixel.x + noise(random), pixel.y + noise(random)});
            }
            if (percent(random) < 50) std::swap(seen[0], seen[1]);
            if (percent(random) < 4) seen[0] = {10.0 * percent(random), 9.0 * percent(random)};
            if (percent(random) < 80) procedure.add_observation(m, c, seen);
        }
    }
    const auto result = procedure.solve();
    ASSERT_TRUE(result.ok()) << result.status();
    ASSERT_EQ(result->cameras.size(), 5u);
    std::vector<Vec3> from, to;
    for (int c = 0; c < 5; ++c)
        from.push_back(result->cameras[c].centre_in_world()), to.push_back(truth[c].centre_in_world());
    EXPECT_NEAR(align_points(from, to, true)->scale, 1, 0.002);
    const SimilarityTransform aligned = *align_points(from, to, false);
    for (int c = 0; c < 5; ++c) EXPECT_LT(norm(aligned(from[c]) - to[c]), 0.005);
    EXPECT_EQ(worst(result->findings), Verdict::kGo);
}

}  // namespace
}  // namespace kinevox::studio
