// Common mistakes with a wand, the floor and a person, and those that a board cannot detect. Each ends in
// CAUTION or NO-GO with the right finding, or needs the evidence shown here.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <numbers>

#include "server/calibration/board/floor.h"
#include "server/calibration/certificate/solved_certificate.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/person/diagnosis.h"
#include "server/calibration/wand/wand.h"
#include "tests/unit/calibration/synthetic_views.h"

namespace kinevox {
namespace {

using testing::board_at;
using testing::intrinsics_from;
using testing::kBoard;
using testing::ring;
using testing::see_board;

std::string text_of(const std::vector<Finding>& findings) {
    std::string all;
    for (const Finding& f : findings)
        all += std::string(to_text(f.verdict)) + " " + f.check + " " + f.camera + ": " + f.reason + "\n";
    return all;
}

// True if there is such a finding, not GO, with a remedy, about the camera (any if empty).
bool has(const std::vector<Finding>& findings, const std::string& check, const std::string& camera) {
    for (const Finding& f : findings)
        if (f.check == check && (camera.empty() || f.camera == camera) && f.verdict != Verdict::kGo &&
            !f.remedy.empty())
            return true;
    return false;
}

struct WandCase {
    const char* what;
    const char* check;  // empty: no mistake
    const char* camera;
    int frame_sets = 90;
    std::function<void(int frame_set, std::vector<Camera>&)> cameras;  // true cameras
    std::function<void(std::vector<Camera>&)> intrinsics;              // assumed intrinsics
    std::function<void(int camera, std::vector<Vec2>&)> detection;
    bool held_one_way = false;
};

TEST(CalibrationMistakes, WandFindingsNameTheMistake) {
    const auto other_intrinsics = [](Camera& camera) { camera.fx = camera.fy *= 1.12, camera.k1 = -0.1; };
    const WandCase table[] = {
        {"no mistake", "", ""},
        {"two cameras' videos swapped", "cameras_swapped", "cam1", 90,
         [&](int, std::vector<Camera>& c) { other_intrinsics(c[0]); },
         [&](std::vector<Camera>& c) { other_intrinsics(c[1]); }},
        {"a camera moved meanwhile", "camera_moved", "cam3", 90,
         [](int frame_set, std::vector<Camera>& c) {
             if (frame_set >= 45) c[2] = studio::bumped_camera(c[2], {0, 0.02, 0.01}, {});
         }},
        {"too few frame sets", "unconnected_camera", "", 13},
        {"constant direction", "uniform_tilt", "", 90, {}, {}, {}, true},
        {"a mirrored image",
         "inconsistent_camera",
         "cam2",
         90,
         {},
         {},
         [](int camera, std::vector<Vec2>& balls) {
             for (Vec2& ball : balls)
                 if (camera == 1) ball.x = 1279 - ball.x;
         }},
    };
    for (const char* text : {"wand:200:600", "wand:600"})
        for (const WandCase& test : table) {
            SCOPED_TRACE(std::string(text) + ": " + test.what);
            const std::vector<Camera> truth = ring(4);
            std::vector<Camera> intrinsics = intrinsics_from(truth);
            if (test.intrinsics) test.intrinsics(intrinsics);
            const WandSpec wand = *parse_wand(text);
            studio::Staging staging;
            staging.wand = studio::StagedWand{};
            for (const Vec3 ball : wand.balls()) staging.wand->along_m.push_back(ball.x);
            WandProcedure procedure(intrinsics, wand);
            std::mt19937 random(7);
            std::normal_distribution<double> noise(0, 0.15);
            for (int m = 0; m < test.frame_sets; ++m) {
                std::vector<Camera> cameras = truth;
                if (test.cameras) test.cameras(m, cameras);
                Rigid3 pose = studio::world_from_target(staging, truth, m, 10);
                if (test.held_one_way) pose.rotation = rotation_z(0.4) * rotation_y(0.5);
                for (int c = 0; c < 4; ++c) {
                    std::vector<Vec2> balls;
                    for (const Vec3 ball : wand.balls()) {
                        const Vec2 pixel = *cameras[c].project(pose * ball);
                        balls.push_back({pixel.x + noise(random), pixel.y + noise(random)});
                    }
                    if (test.detection) test.detection(c, balls);
                    procedure.add_observation(m, c, balls);
                }
            }
            const auto result = procedure.solve();
            ASSERT_TRUE(result.ok()) << result.status();
            if (*test.check) {
                EXPECT_TRUE(has(result->findings, test.check, test.camera)) << text_of(result->findings);
            } else {
                EXPECT_EQ(worst(result->findings), Verdict::kGo) << text_of(result->findings);
            }
        }
}

// A wrong square size is as consistent as the right one: the board alone gives GO. Only a known length
// reveals it.
TEST(CalibrationMistakes, KnownLengthRevealsWrongSquareSize) {
    const std::vector<Camera> truth = ring(4);
    BoardSpec believed = kBoard;
    believed.square_m = 0.15, believed.marker_m = 0.1125;
    ExtrinsicsOptions options;
    options.solve_delays = false;
    ExtrinsicsProcedure procedure(intrinsics_from(truth), believed, options);
    std::mt19937 random(7);
    for (int m = 0; m < 60; ++m)
        for (int c = 0; c < 4; ++c)
            procedure.add_observation(m, c, see_board(truth[c], kBoard.points(), board_at(truth, m), random));
    const auto result = procedure.solve();
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_EQ(worst(result->findings), Verdict::kGo) << text_of(result->findings);
    // Four points of the floor, as measured with a tape.
    std::vector<FloorPoint> points;
    for (const Vec3 p : {Vec3{-1, -1, 0}, Vec3{1, -1, 0}, Vec3{1, 1, 0}, Vec3{-1, 1, 0}}) {
        FloorPoint point{p, {}};
        for (int c = 0; c < 4; ++c) point.clicks.push_back({c, *truth[c].project(p)});
        points.push_back(point);
    }
    const auto floor = floor_from_points(result->cameras, points);
    ASSERT_TRUE(floor.ok()) << floor.status();
    EXPECT_TRUE(has(floor->findings, "scale", "")) << text_of(floor->findings);
    // A person of 1.80 m is measured 15/16 as tall.
    const auto findings = check_world(truth, SubjectExtent{0, 1.8 * 15 / 16, 0.3}, 1.80);
    EXPECT_TRUE(has(findings, "scale", "")) << text_of(findings);
}

TEST(CalibrationMistakes, FloorFindsMirroredBoardAndRolledCamera) {
    const std::vector<Camera> truth = ring(4);
    std::mt19937 random(3);
    for (const bool mirrored : {false, true}) {
        std::vector<std::vector<Corner>> seen;
        for (const Camera& camera : truth) {
            seen.push_back(
                see_board(camera, kBoard.points(), {rotation_z(0.7), {0.3, -0.4, 0}}, random).corners);
            for (Corner& corner : seen.back())
                if (mirrored) corner.id = corner.id / 5 * 5 + 4 - corner.id % 5;
        }
        const auto floor = floor_from_board(truth, kBoard.points(), seen);
        ASSERT_TRUE(floor.ok()) << floor.status();
        std::vector<Camera> cameras = truth;
        move_cameras({1, floor->world_from_old}, cameras);
        const auto findings = check_world(cameras, std::nullopt, std::nullopt);
        EXPECT_EQ(has(findings, "target_mirrored", ""), mirrored) << text_of(findings);
    }
    // Mounted upside down: the extrinsics are right, the world frame reveals it.
    std::vector<Camera> hanging = truth;
    hanging[3] = studio::bumped_camera(hanging[3], {0, 0, std::numbers::pi}, {});
    ExtrinsicsOptions options;
    options.solve_delays = false;
    ExtrinsicsProcedure procedure(intrinsics_from(hanging), kBoard, options);
    for (int m = 0; m < 60; ++m)
        for (int c = 0; c < 4; ++c) {
            const Rigid3 pose = m == 0 ? Rigid3{{}, {-0.4, -0.3, 0}} : board_at(hanging, m);
            procedure.add_observation(m, c, see_board(hanging[c], kBoard.points(), pose, random));
        }
    auto result = procedure.solve();
    ASSERT_TRUE(result.ok()) << result.status();
    const int lying = 0;
    ASSERT_TRUE(define_world_by_board({&lying, 1}, *result).ok());
    const Certificate certificate = extrinsics_certificate("extrinsics_board", *std::move(result), true);
    EXPECT_TRUE(has(certificate.findings, "camera_upside_down", "cam4")) << text_of(certificate.findings);
}

struct PersonCase {
    const char* what;
    std::vector<const char*> checks;  // one of them; empty: no mistake
    const char* camera;
    std::function<void(std::size_t frame_set, std::vector<SilhouetteMask>&)> images;
    std::function<void(std::vector<Camera>&)> believed;
};

TEST(CalibrationMistakes, SilhouetteFindingsNameTheMistake) {
    studio::StudioOptions options;
    options.width = 400, options.height = 300, options.fps = 1.5;
    const auto studio = *studio::Studio::create(options);
    options.staging.bump = studio::CameraBump{1, 0, 7};
    const auto bumped = *studio::Studio::create(options);
    constexpr int kFrameSets = 15;
    std::vector<std::vector<SilhouetteMask>> still(kFrameSets), moved(kFrameSets);
    for (int m = 0; m < kFrameSets; ++m) {
        for (auto& mask : studio->masks(m)) still[m].push_back({std::move(mask), false});
        for (auto& mask : bumped->masks(m)) moved[m].push_back({std::move(mask), false});
    }
    const PersonCase table[] = {
        {"no mistake", {}, "", {}, {}},
        {"two cameras' videos swapped",
         {"cameras_swapped"},
         "cam1",
         [](std::size_t, std::vector<SilhouetteMask>& p) { std::swap(p[0], p[1]); },
         {}},
        {"an image upside down",
         {"image_upside_down"},
         "cam3",
         [](std::size_t, std::vector<SilhouetteMask>& p) {
             std::reverse(p[2].mask.begin(), p[2].mask.end());
         },
         {}},
        {"a camera moved before the session",
         {"camera_moved"},
         "cam2",
         [&](std::size_t m, std::vector<SilhouetteMask>& p) { p[1] = moved[m][1]; },
         {}},
        {"a camera moved during the session",
         {"camera_moved", "silhouette_residual"},
         "",
         [&](std::size_t m, std::vector<SilhouetteMask>& p) {
             if (m >= kFrameSets / 2) p[1] = moved[m][1];
         },
         {}},
    };
    for (const PersonCase& test : table) {
        SCOPED_TRACE(test.what);
        SilhouetteSet set{still};
        for (std::size_t m = 0; test.images && m < set.frame_sets.size(); ++m)
            test.images(m, set.frame_sets[m]);
        std::vector<Camera> cameras = studio->cameras();
        if (test.believed) test.believed(cameras);
        const auto findings = diagnose_silhouettes(cameras, set);
        ASSERT_TRUE(findings.ok()) << findings.status();
        bool found = test.checks.empty() && worst(*findings) == Verdict::kGo;
        for (const char* check : test.checks) found = found || has(*findings, check, test.camera);
        EXPECT_TRUE(found) << text_of(*findings);
    }
}

}  // namespace
}  // namespace kinevox
