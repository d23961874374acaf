// Common mistakes with a board: the verdict is not GO and the findings name the mistake.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "server/calibration/board/intrinsics.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/person/diagnosis.h"
#include "tests/unit/calibration/synthetic_views.h"

namespace kinevox {
namespace {

using testing::board_at;
using testing::intrinsics_from;
using testing::kBoard;
using testing::ring;
using testing::see_board;

struct Wrong {
    const char* what;
    const char* check;   // of the expected finding; empty: no mistake
    const char* camera;  // expected in the finding; empty: any
    int frame_sets = 60;
    std::function<void(int frame_set, std::vector<Camera>& cameras)> cameras;  // true cameras
    std::function<void(BoardDetection&)> detection;
    std::function<void(std::vector<Camera>&)> intrinsics;  // assumed intrinsics
    std::function<Rigid3(const std::vector<Camera>&, int)> board = board_at;
};

absl::StatusOr<ExtrinsicsResult> calibrate(const Wrong& wrong) {
    const std::vector<Camera> truth = ring(4);
    std::vector<Camera> intrinsics = intrinsics_from(truth);
    if (wrong.intrinsics) wrong.intrinsics(intrinsics);
    ExtrinsicsOptions options;
    options.solve_delays = false;
    ExtrinsicsProcedure procedure(intrinsics, kBoard, options);
    std::mt19937 random(7);
    for (int m = 0; m < wrong.frame_sets; ++m) {
        std::vector<Camera> cameras = truth;
        if (wrong.cameras) wrong.cameras(m, cameras);
        for (int c = 0; c < 4; ++c) {
            BoardDetection seen = see_board(cameras[c], kBoard.points(), wrong.board(truth, m), random);
            if (wrong.detection) wrong.detection(seen);
            procedure.add_observation(m, c, seen);
        }
    }
    return procedure.solve();
}

TEST(BoardMistakes, FindingsNameTheMistake) {
    const Wrong table[] = {
        {"all is well", "", ""},
        {"mirrored board",
         "target_mirrored",
         "",
         60,
         {},
         [](BoardDetection& seen) {
             for (Corner& corner : seen.corners) corner.id = corner.id / 5 * 5 + 4 - corner.id % 5;
         }},
        {"two cameras swapped",
         "cameras_swapped",
         "cam1",
         60,
         {},
         {},
         [](std::vector<Camera>& intrinsics) {
             std::swap(intrinsics[0], intrinsics[1]);
             std::swap(intrinsics[0].name, intrinsics[1].name);
         }},
        {"one camera moved", "camera_moved", "cam3", 60,
         [](int frame_set, std::vector<Camera>& cameras) {
             if (frame_set >= 30) cameras[2] = studio::bumped_camera(cameras[2], {0, 0.02, 0.01}, {0, 0, 0});
         }},
        {"too few views", "too_few_views", "", 12},
        {"flat in all views",
         "uniform_tilt",
         "",
         60,
         {},
         {},
         {},
         [](const std::vector<Camera>&, int frame_set) {
             return Rigid3{
                 {}, {-0.8 + 0.1 * (frame_set % 8), -0.8 + 0.1 * (frame_set / 8), 0.02 * (frame_set % 5)}};
         }},
    };
    for (const Wrong& wrong : table) {
        SCOPED_TRACE(wrong.what);
        Wrong tried = wrong;
        // Different intrinsics, so that an exchange shows.
        if (std::string(wrong.check) == "cameras_swapped")
            tried.cameras =
                [](int, std::vector<Camera>& cameras) {
                    cameras[0].fx = cameras[0].fy *= 1.12, cameras[0].k1 = -0.1;
                },
            tried.intrinsics = [](std::vector<Camera>& intrinsics) {
                intrinsics[1].fx = intrinsics[1].fy *= 1.12, intrinsics[1].k1 = -0.1;
            };
        const auto result = calibrate(tried);
        ASSERT_TRUE(result.ok()) << result.status();
        std::string all;
        bool found = false;
        for (const Finding& finding : result->findings) {
            all += finding.check + " (" + finding.camera + "): " + finding.reason + "\n";
            found =
                found || (finding.check == wrong.check && (!*wrong.camera || finding.camera == wrong.camera));
            EXPECT_FALSE(finding.remedy.empty());
        }
        if (!*wrong.check) {
            EXPECT_EQ(worst(result->findings), Verdict::kGo) << all;
            EXPECT_LT(*result->held_out_rms_px, 0.35);
            EXPECT_LT(std::abs(result->scale->bias_mm_per_m), 1);
        } else {
            EXPECT_TRUE(found) << all;
            EXPECT_NE(worst(result->findings), Verdict::kGo) << all;
        }
    }
}

TEST(BoardMistakes, NamesCamerasWithoutSharedViews) {
    const std::vector<Camera> truth = ring(4);
    ExtrinsicsProcedure procedure(intrinsics_from(truth), kBoard);
    std::mt19937 random(7);
    for (int m = 0; m < 40; ++m)
        for (int c = 0; c < 3; ++c)
            procedure.add_observation(m, c, see_board(truth[c], kBoard.points(), board_at(truth, m), random));
    EXPECT_THAT(procedure.hints(), ::testing::Contains("camera cam4 has not detected the board"));
    const auto result = procedure.solve();
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_THAT(result->excluded_cameras, ::testing::ElementsAre("cam4"));
    EXPECT_EQ(worst(result->findings), Verdict::kNoGo);
}

TEST(BoardMistakes, RefusesIntrinsicsFromFlatViews) {
    const Camera camera = ring(4)[0];
    std::mt19937 random(2);
    for (const bool flat : {true, false}) {
        IntrinsicsProcedure procedure("cam1", camera.width, camera.height, kBoard);
        const Mat3 facing = camera.camera_from_world.rotation.transposed() * rotation_x(3.14159265358979);
        for (int m = 0; m < 24; ++m) {
            const Mat3 tilt =
                flat ? Mat3{} : rotation_x(0.5 * std::sin(1.0 * m)) * rotation_y(0.5 * std::cos(1.7 * m));
            const Vec3 in_camera{-1.2 + 0.35 * (m % 5), 0.9 - 0.35 * (m / 5), 2.6 + 0.2 * (m % 3)};
            const Rigid3 pose{facing * tilt, camera.camera_from_world.inverse() * in_camera};
            procedure.add_observation(m, see_board(camera, kBoard.points(), pose, random));
        }
        const auto result = procedure.solve();
        ASSERT_TRUE(result.ok()) << result.status();
        const bool refused = std::any_of(
            result->findings.begin(), result->findings.end(),
            [](const Finding& f) { return f.check == "uniform_tilt" && f.verdict == Verdict::kNoGo; });
        EXPECT_EQ(refused, flat);
        if (!flat) {
            EXPECT_NEAR(result->camera.fx / camera.fx, 1, 0.005);
        }
    }
}

TEST(BoardMistakes, ChecksTheWorldFrame) {
    const std::vector<Camera> good = ring(4);
    const SubjectExtent person{0.01, 1.79, 0.3};
    EXPECT_TRUE(check_world(good, person, 1.78).empty());
    const auto checks = [](const std::vector<Finding>& findings) {
        std::string all;
        for (const Finding& f : findings)
            all += std::string(to_text(f.verdict)) + " " + f.check + " " + f.camera + ";";
        return all;
    };
    std::vector<Camera> mirrored = good, hanging = good;
    move_cameras({1, {rotation_x(3.14159265358979), {}}}, mirrored);
    EXPECT_EQ(checks(check_world(mirrored, std::nullopt, std::nullopt)), "NO-GO target_mirrored ;");
    hanging[2] = studio::bumped_camera(hanging[2], {0, 0, 3.14159265358979}, {});
    EXPECT_EQ(checks(check_world(hanging, person, std::nullopt)), "CAUTION camera_upside_down cam3;");
    EXPECT_EQ(checks(check_world(good, SubjectExtent{0.01, 1.61, 0.3}, 1.78)), "NO-GO scale ;");
    EXPECT_EQ(checks(check_world(good, SubjectExtent{-0.5, 1.28, 0.3}, 1.78)), "NO-GO feet_height ;");
    EXPECT_EQ(checks(check_world(good, SubjectExtent{0.01, 0.5, 1.7}, std::nullopt)),
              "NO-GO subject_not_upright ;");
}

}  // namespace
}  // namespace kinevox
