// What people do wrong, beyond the board: with a wand, with the floor, with a person; and what no board can
// tell. Each ends in CARE or NO-GO with the right reason, or it is told which evidence is needed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <numbers>

#include "server/calibration/diagnosis.h"
#include "server/calibration/floor.h"
#include "server/calibration/solved_certificate.h"
#include "server/calibration/triangulation.h"
#include "server/calibration/wand.h"
#include "tests/unit/calibration/synthetic_views.h"

namespace kinevox {
namespace {

using testing::board_at;
using testing::kBoard;
using testing::lenses_of;
using testing::ring;
using testing::see_board;

std::string told(const std::vector<Finding>& findings) {
    std::string all;
    for (const Finding& f : findings)
        all += std::string(to_text(f.verdict)) + " " + f.check + " " + f.camera + ": " + f.reason + "\n";
    return all;
}

// Whether there is such a finding, not GO, with a remedy, naming the camera (any if empty).
bool has(const std::vector<Finding>& findings, const std::string& check, const std::string& camera) {
    for (const Finding& f : findings)
        if (f.check == check && (camera.empty() || f.camera == camera) && f.verdict != Verdict::kGo &&
            !f.remedy.empty())
            return true;
    return false;
}

struct WandCase {
    const char* what;
    const char* check;  // empty: all is well
    const char* camera;
    int moments = 90;
    std::function<void(int moment, std::vector<Camera>&)> cameras;  // as they stand
    std::function<void(std::vector<Camera>&)> lenses;               // as they are believed
    std::function<void(int camera, std::vector<Vec2>&)> sighting;
    bool held_one_way = false;
};

TEST(WrongProcedures, WandGivesTheReason) {
    const auto other_lens = [](Camera& camera) { camera.fx = camera.fy *= 1.12, camera.k1 = -0.1; };
    const WandCase table[] = {
        {"all is well", "", ""},
        {"two cameras' videos swapped", "swapped", "cam1", 90,
         [&](int, std::vector<Camera>& c) { other_lens(c[0]); },
         [&](std::vector<Camera>& c) { other_lens(c[1]); }},
        {"a camera knocked meanwhile", "knocked", "cam3", 90,
         [](int moment, std::vector<Camera>& c) {
             if (moment >= 45) c[2] = studio::knocked(c[2], {0, 0.02, 0.01}, {});
         }},
        {"too few moments", "unconnected", "", 13},
        {"held the same way all the time", "flat", "", 90, {}, {}, {}, true},
        {"a camera that mirrors its picture",
         "odd_camera",
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
            std::vector<Camera> lenses = lenses_of(truth);
            if (test.lenses) test.lenses(lenses);
            const WandSpec wand = *parse_wand(text);
            studio::Staging staging;
            staging.wand = studio::StagedWand{};
            for (const Vec3 ball : wand.balls()) staging.wand->along_m.push_back(ball.x);
            WandProcedure procedure(lenses, wand);
            std::mt19937 random(7);
            std::normal_distribution<double> noise(0, 0.15);
            for (int m = 0; m < test.moments; ++m) {
                std::vector<Camera> cameras = truth;
                if (test.cameras) test.cameras(m, cameras);
                Rigid3 pose = studio::world_from_prop(staging, truth, m, 10);
                if (test.held_one_way) pose.rotation = rotation_z(0.4) * rotation_y(0.5);
                for (int c = 0; c < 4; ++c) {
                    std::vector<Vec2> balls;
                    for (const Vec3 ball : wand.balls()) {
                        const Vec2 pixel = *cameras[c].project(pose * ball);
                        balls.push_back({pixel.x + noise(random), pixel.y + noise(random)});
                    }
                    if (test.sighting) test.sighting(c, balls);
                    procedure.add_observation(m, c, balls);
                }
            }
            const auto result = procedure.solve();
            ASSERT_TRUE(result.ok()) << result.status();
            if (*test.check) {
                EXPECT_TRUE(has(result->findings, test.check, test.camera)) << told(result->findings);
            } else {
                EXPECT_EQ(worst(result->findings), Verdict::kGo) << told(result->findings);
            }
        }
}

// A wrong square size makes a world that is as consistent as the right one: the board alone says GO. What has
// a known length says otherwise.
TEST(WrongProcedures, AWrongSquareSizeIsToldByWhatHasAKnownLength) {
    const std::vector<Camera> truth = ring(4);
    BoardSpec believed = kBoard;
    believed.square_m = 0.15, believed.marker_m = 0.1125;
    ExtrinsicsOptions options;
    options.solve_delays = false;
    ExtrinsicsProcedure procedure(lenses_of(truth), believed, options);
    std::mt19937 random(7);
    for (int m = 0; m < 60; ++m)
        for (int c = 0; c < 4; ++c)
            procedure.add_observation(m, c, see_board(truth[c], kBoard.points(), board_at(truth, m), random));
    const auto result = procedure.solve();
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_EQ(worst(result->findings), Verdict::kGo) << told(result->findings);
    // Four points of the floor, as measured with a tape.
    std::vector<FloorPoint> points;
    for (const Vec3 p : {Vec3{-1, -1, 0}, Vec3{1, -1, 0}, Vec3{1, 1, 0}, Vec3{-1, 1, 0}}) {
        FloorPoint point{p, {}};
        for (int c = 0; c < 4; ++c) point.clicks.push_back({c, *truth[c].project(p)});
        points.push_back(point);
    }
    const auto floor = floor_from_points(result->cameras, points);
    ASSERT_TRUE(floor.ok()) << floor.status();
    EXPECT_TRUE(has(floor->findings, "scale", "")) << told(floor->findings);
    // A person of 1.80 m comes out 15/16 as tall.
    const auto findings = check_world(truth, SubjectExtent{0, 1.8 * 15 / 16, 0.3}, 1.80);
    EXPECT_TRUE(has(findings, "scale", "")) << told(findings);
}

TEST(WrongProcedures, AMirroredOrHangingCameraOnTheFloor) {
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
        EXPECT_EQ(has(findings, "mirrored", ""), mirrored) << told(findings);
    }
    // Mounted upside down for all of it: the board does not mind, the world tells.
    std::vector<Camera> hanging = truth;
    hanging[3] = studio::knocked(hanging[3], {0, 0, std::numbers::pi}, {});
    ExtrinsicsOptions options;
    options.solve_delays = false;
    ExtrinsicsProcedure procedure(lenses_of(hanging), kBoard, options);
    for (int m = 0; m < 60; ++m)
        for (int c = 0; c < 4; ++c) {
            const Rigid3 pose = m == 0 ? Rigid3{{}, {-0.4, -0.3, 0}} : board_at(hanging, m);
            procedure.add_observation(m, c, see_board(hanging[c], kBoard.points(), pose, random));
        }
    auto result = procedure.solve();
    ASSERT_TRUE(result.ok()) << result.status();
    const int lying = 0;
    ASSERT_TRUE(set_world_by_board({&lying, 1}, *result).ok());
    const Certificate certificate = place_certificate("board", *std::move(result), true);
    EXPECT_TRUE(has(certificate.findings, "upside_down", "cam4")) << told(certificate.findings);
}

struct PersonCase {
    const char* what;
    std::vector<const char*> checks;  // one of them; empty: all is well
    const char* camera;
    std::function<void(std::size_t moment, std::vector<SilhouettePicture>&)> pictures;
    std::function<void(std::vector<Camera>&)> believed;
};

TEST(WrongProcedures, SilhouettesGiveTheReason) {
    studio::StudioOptions options;
    options.width = 400, options.height = 300, options.fps = 1.5;
    const auto studio = *studio::Studio::create(options);
    options.staging.knock = studio::Knock{1, 0, 7};
    const auto knocked = *studio::Studio::create(options);
    constexpr int kMoments = 15;
    std::vector<std::vector<SilhouettePicture>> still(kMoments), moved(kMoments);
    for (int m = 0; m < kMoments; ++m) {
        for (auto& mask : studio->masks(m)) still[m].push_back({std::move(mask), false});
        for (auto& mask : knocked->masks(m)) moved[m].push_back({std::move(mask), false});
    }
    const PersonCase table[] = {
        {"all is well", {}, "", {}, {}},
        {"two cameras' videos swapped",
         {"swapped"},
         "cam1",
         [](std::size_t, std::vector<SilhouettePicture>& p) { std::swap(p[0], p[1]); },
         {}},
        {"a picture upside down",
         {"upside_down"},
         "cam3",
         [](std::size_t, std::vector<SilhouettePicture>& p) {
             std::reverse(p[2].mask.begin(), p[2].mask.end());
         },
         {}},
        {"a camera knocked before the recording",
         {"knocked"},
         "cam2",
         [&](std::size_t m, std::vector<SilhouettePicture>& p) { p[1] = moved[m][1]; },
         {}},
        {"a camera knocked during the recording",
         {"knocked", "silhouettes"},
         "",
         [&](std::size_t m, std::vector<SilhouettePicture>& p) {
             if (m >= kMoments / 2) p[1] = moved[m][1];
         },
         {}},
    };
    for (const PersonCase& test : table) {
        SCOPED_TRACE(test.what);
        SilhouetteSet set{still};
        for (std::size_t m = 0; test.pictures && m < set.moments.size(); ++m)
            test.pictures(m, set.moments[m]);
        std::vector<Camera> cameras = studio->cameras();
        if (test.believed) test.believed(cameras);
        const auto findings = diagnose_silhouettes(cameras, set);
        ASSERT_TRUE(findings.ok()) << findings.status();
        bool found = test.checks.empty() && worst(*findings) == Verdict::kGo;
        for (const char* check : test.checks) found = found || has(*findings, check, test.camera);
        EXPECT_TRUE(found) << told(*findings);
    }
}

}  // namespace
}  // namespace kinevox
