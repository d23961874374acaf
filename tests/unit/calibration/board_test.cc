#include "server/calibration/board/board.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/calibration/board/board_detector.h"
#include "server/calibration/board/posed_views.h"
#include "tests/unit/calibration/synthetic_views.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(Board, RoundTripsThroughText) {
    for (const char* text :
         {"checkerboard:4x7:60", "charuco:4x5:54:40.5:DICT_4X4_1000:inverted", "aprilgrid:6x6:88:26.4"}) {
        const auto board = parse_board(text);
        ASSERT_TRUE(board.ok()) << board.status();
        EXPECT_EQ(board_text(*board), text);
    }
    EXPECT_EQ(parse_board("charuco:4x5:54:40.5:DICT_4X4_1000")->points().size(), 12u);
    EXPECT_TRUE(parse_board("checkerboard:4x7:60")->has_direction());
    EXPECT_FALSE(parse_board("checkerboard:5x7:60")->has_direction());
}

TEST(Board, RefusesInvalidTextInOneLine) {
    for (const char* text :
         {"", "chess:4x7:60", "checkerboard:4x7", "checkerboard:4:60", "checkerboard:4x7:-60",
          "checkerboard:4x7:nan", "charuco:4x5:54:60:DICT_4X4_50", "charuco:4x5:54:40:DICT:x:y",
          "checkerboard:999999999999x7:60", "charuco:4\n5:54:40:DICT_4X4_50"}) {
        const auto board = parse_board(text);
        ASSERT_FALSE(board.ok()) << text;
        EXPECT_THAT(std::string(board.status().message()), HasSubstr("charuco:4x5"));
        EXPECT_THAT(std::string(board.status().message()), Not(HasSubstr("\n")));
    }
    EXPECT_FALSE(BoardDetector::create(*parse_board("charuco:4x5:54:40:DICT_5")).ok());
}

// Each kind, drawn by the studio: its points are detected at their true positions, seen from the printed
// side.
TEST(Board, DetectsEveryKindAtItsPosition) {
    const Camera camera = testing::ring(4)[0];
    const Vec3 eye = camera.centre_in_world();
    std::shared_ptr<std::uint8_t[]> grey(new std::uint8_t[1280 * 960 * 3]);
    std::fill(grey.get(), grey.get() + 1280 * 960 * 3, std::uint8_t{120});
    const Image wall{1280, 960, 3, grey};
    for (const char* text : {"checkerboard:6x5:120", "charuco:6x5:160:120:DICT_4X4_100",
                             "charuco:6x5:160:120:DICT_4X4_100:inverted", "aprilgrid:4x3:200:60"}) {
        SCOPED_TRACE(text);
        const BoardSpec board = *parse_board(text);
        auto detector = BoardDetector::create(board);
        ASSERT_TRUE(detector.ok()) << detector.status();
        studio::Print print;
        print.grey = (*detector)->draw(print.pixels_per_m, print.origin_px);
        const Vec3 z = normalized(eye - Vec3{0, 0, 1.2}), x = normalized(cross({0, 0, 1}, z)),
                   y = cross(z, x);
        const Mat3 facing = Mat3{{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}} * rotation_x(0.3) *
                            rotation_y(-0.25) * rotation_z(0.2);
        const Rigid3 world_from_board{facing, Vec3{0, 0, 1.2} - facing * Vec3{0.45, 0.35, 0}};
        const Image image = studio::draw_print(wall, camera, print, world_from_board, 1.4, 3);
        const BoardDetection seen = (*detector)->detect(image);
        ASSERT_TRUE(seen.found());
        EXPECT_GE(seen.corners.size(), board.points().size() * 3 / 4);
        double sum = 0;
        for (const Corner& corner : seen.corners) {
            const auto truth = camera.project(world_from_board * board.points()[corner.id]);
            sum += std::hypot(truth->x - corner.pixel.x, truth->y - corner.pixel.y);
        }
        EXPECT_LT(sum / static_cast<double>(seen.corners.size()), 0.35);
        EXPECT_GT(seen.edge_px, 0.5);
        EXPECT_LT(seen.edge_px, 4);
        const auto pose = board_pose(camera, seen.corners, board.points());
        ASSERT_TRUE(pose.has_value());
        EXPECT_LT(pose->tilt_rad, 0.6);
    }
}

}  // namespace
}  // namespace kinevox
