// Floor and origin from a board, from clicked points and from a person who walks, against the virtual
// studio's truth.
#include "server/calibration/board/floor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "common/geometry.h"
#include "server/calibration/board/board.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/person/diagnosis.h"
#include "server/calibration/person/person_world.h"
#include "tests/unit/calibration/synthetic_views.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;
using testing::ring;
using testing::see_board;

// An arbitrary earlier world frame.
const Rigid3 kOldFromTruth{rotation_x(1.9) * rotation_y(-0.4) * rotation_z(2.2), {0.7, -1.2, 4.1}};

std::vector<Camera> in_old(std::vector<Camera> cameras, double scale = 1) {
    move_cameras({scale, kOldFromTruth}, cameras);
    return cameras;
}

// Difference between the world frame found and the true one.
struct WorldError {
    double tilt_deg = 0, height_mm = 0;  // of the floor, at the room's middle
    Rigid3 truth_from_world;
};
WorldError error_of(const FloorResult& floor) {
    WorldError error;
    const Rigid3 world_from_truth = floor.world_from_old * kOldFromTruth;
    error.truth_from_world = world_from_truth.inverse();
    const Vec3 up{world_from_truth.rotation(2, 0), world_from_truth.rotation(2, 1),
                  world_from_truth.rotation(2, 2)};
    error.tilt_deg = degrees(std::acos(std::clamp(up.z, -1.0, 1.0)));
    error.height_mm = 1000 * world_from_truth.translation.z;
    return error;
}

TEST(Floor, BoardDefinesTheWorldFrame) {
    const std::vector<Camera> truth = ring(4);
    const std::vector<Vec3> points = testing::kBoard.points();
    const Rigid3 world_from_board{rotation_z(0.7), {0.3, -0.4, 0.01}};  // on a board of 10 mm
    std::mt19937 random(3);
    std::vector<std::vector<Corner>> seen;
    for (const Camera& camera : truth)
        seen.push_back(see_board(camera, points, world_from_board, random).corners);
    const auto floor = floor_from_board(in_old(truth), points, seen, 0.01);
    ASSERT_TRUE(floor.ok()) << floor.status();
    EXPECT_LT(error_of(*floor).tilt_deg, 0.1);
    EXPECT_NEAR(error_of(*floor).height_mm, 0, 2);
    const Vec3 origin = error_of(*floor).truth_from_world * Vec3{0, 0, 0.01};
    EXPECT_LT(norm(origin - world_from_board.translation), 0.003);
    EXPECT_TRUE(floor->findings.empty());
    // One camera alone gives CAUTION.
    for (std::size_t c = 1; c < 4; ++c) seen[c].clear();
    const auto alone = floor_from_board(in_old(truth), points, seen);
    ASSERT_TRUE(alone.ok());
    ASSERT_EQ(alone->findings.size(), 1u);
    EXPECT_EQ(alone->findings[0].check, "single_view");
    EXPECT_FALSE(floor_from_board(in_old(truth), points, std::vector<std::vector<Corner>>(4)).ok());
}

struct PointsCase {
    const char* what;
    std::vector<Vec3> in_world;
    std::vector<int> cameras;  // that click
    bool known = true;
    double click_std_px = 0.5;
    double max_tilt_deg = 0.3, max_mm = 15;
    const char* check = "";  // the finding expected; none if empty
    std::function<void(std::vector<FloorPoint>&)> spoil;
    double scale = 1;
};

TEST(Floor, PointsDefineTheWorldFrame) {
    const std::vector<Vec3> three{{0, 0, 0}, {1.5, 0, 0}, {0.2, 1.2, 0}};
    const std::vector<Vec3> four{{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
    const std::vector<Vec3> room{{-1, -1, 0}, {1, -1, 0}, {1, 1, 0.8}, {-1, 1, 1.5}, {0, 0, 0}};
    const PointsCase table[] = {
        {"three, four cameras", three, {0, 1, 2, 3}},
        {"three, two cameras", three, {0, 1}, true, 0.5, 0.6},
        {"three, one camera: cameras are above the floor", three, {2}, true, 0.1, 1.0, 60, "?"},
        {"four, one camera", four, {1}, true, 0.2, 0.5, 25},
        {"points off the floor too", room, {0, 2, 3}},
        {"floor only, unknown coordinates", four, {0, 1, 2}, false},
        {"three of the floor, unknown", three, {1, 2}, false, 0.5, 0.6},
        {"a wrong click",
         four,
         {0, 1, 2, 3},
         true,
         0.5,
         3,
         200,
         "clicked_points",
         [](std::vector<FloorPoint>& points) { points[1].clicks[2].second.x += 120; }},
        {"unknown, one clicked on a chair",
         four,
         {0, 1, 2, 3},
         false,
         0.5,
         15,
         500,
         "floor_flatness",
         [](std::vector<FloorPoint>& points) {
             for (auto& [camera, pixel] : points[2].clicks) pixel = *ring(4)[camera].project({1, 1, 0.45});
         }},
        {"cameras calibrated with a wrong square size",
         four,
         {0, 1, 2, 3},
         true,
         0.5,
         20,
         2000,
         "scale",
         {},
         1.05},
    };
    for (const PointsCase& test : table) {
        SCOPED_TRACE(test.what);
        const std::vector<Camera> truth = ring(4);
        std::mt19937 random(9);
        std::normal_distribution<double> noise(0, test.click_std_px);
        std::vector<FloorPoint> points;
        for (const Vec3 p : test.in_world) {
            FloorPoint point;
            if (test.known) point.in_world = p;
            for (const int c : test.cameras) {
                const Vec2 pixel = *truth[c].project(p);
                point.clicks.push_back({c, {pixel.x + noise(random), pixel.y + noise(random)}});
            }
            points.push_back(point);
        }
        if (test.spoil) test.spoil(points);
        const auto floor = floor_from_points(in_old(truth, test.scale), points);
        ASSERT_TRUE(floor.ok()) << floor.status();
        const WorldError error = error_of(*floor);
        EXPECT_LT(error.tilt_deg, test.max_tilt_deg);
        if (!*test.check) {
            EXPECT_TRUE(floor->findings.empty()) << floor->findings[0].reason;
            // The requested world frame: its first point, and x towards the second if nothing else is given.
            const Vec3 first = test.known ? test.in_world[0] : Vec3{};
            const Vec3 found = error.truth_from_world * first;
            EXPECT_LT(1000 * norm(found - test.in_world[0]), test.max_mm);
            const Vec3 x = error.truth_from_world.rotation * Vec3{1, 0, 0};
            const Vec3 wanted = test.known ? Vec3{1, 0, 0} : normalized(test.in_world[1] - test.in_world[0]);
            EXPECT_GT(dot(x, wanted), 0.9999);
        } else if (std::string(test.check) != "?") {
            ASSERT_FALSE(floor->findings.empty());
            bool found = false;
            for (const Finding& finding : floor->findings) {
                found = found || finding.check == test.check;
                EXPECT_FALSE(finding.remedy.empty());
            }
            EXPECT_TRUE(found) << floor->findings[0].check;
        }
    }
}

TEST(Floor, RefusesUnusablePoints) {
    const std::vector<Camera> truth = ring(4);
    const auto point = [&](Vec3 p, bool known) {
        FloorPoint out;
        if (known) out.in_world = p;
        for (int c = 0; c < 2; ++c) out.clicks.push_back({c, *truth[c].project(p)});
        return out;
    };
    const auto message_of = [&](const std::vector<FloorPoint>& points) {
        const auto floor = floor_from_points(truth, points);
        return floor.ok() ? std::string("ok") : std::string(floor.status().message());
    };
    EXPECT_THAT(message_of({point({0, 0, 0}, true), point({1, 0, 0}, true)}), HasSubstr("three or four"));
    for (const bool known : {true, false})
        EXPECT_THAT(message_of({point({0, 0, 0}, known), point({1, 0, 0}, known), point({0.5, 0, 0}, known)}),
                    HasSubstr("line"));
    EXPECT_THAT(message_of({point({0, 0, 0}, true), point({1, 0, 0}, false), point({0, 1, 0}, true)}),
                HasSubstr("all points"));
    FloorPoint once = point({0, 1, 0}, false);
    once.clicks.resize(1);
    EXPECT_THAT(message_of({point({0, 0, 0}, false), point({1, 0, 0}, false), once}), HasSubstr("point 3"));
}

TEST(Floor, ReadsPointsFromText) {
    const std::vector<Camera> cameras = ring(4);
    const auto point = parse_floor_point("1,-2.5,0 cam1:412.5,300  cam3:99,120", cameras);
    ASSERT_TRUE(point.ok()) << point.status();
    EXPECT_EQ(*point->in_world, (Vec3{1, -2.5, 0}));
    ASSERT_EQ(point->clicks.size(), 2u);
    EXPECT_EQ(point->clicks[1].first, 2);
    EXPECT_EQ(point->clicks[1].second, (Vec2{99, 120}));
    EXPECT_FALSE(parse_floor_point("cam2:1,2", cameras)->in_world.has_value());
    for (const char* text :
         {"", "1,2,3", "1,2 cam1:3,4", "1,2,nan cam1:3,4", "cam1:3", "cam1:3,4,5", "cam9:3,4", "cam1:9999,4",
          "cam1:3,4 1,2,3", "cam1:3,4 cam1:5,6", "1,2,3 4,5,6 cam1:3,4", "1e9,0,0 cam1:3,4", "cam1:a,b"}) {
        const auto wrong = parse_floor_point(text, cameras);
        ASSERT_FALSE(wrong.ok()) << text;
        EXPECT_THAT(std::string(wrong.status().message()), HasSubstr("write '0,0,0 cam1"));
    }
}

struct WalkCase {
    const char* motion;
    int cameras, frames;
    double seconds;  // over which the frames are spread
    double max_tilt_deg, max_mm;
    bool narrow;  // no walk over an area: the verdict must say so
};

TEST(Floor, WalkingPersonDefinesTheWorldFrame) {
    const WalkCase table[] = {
        {"walk", 4, 40, 10, 0.6, 25, false},
        {"walk", 8, 30, 10, 0.5, 15, false},
        {"squat", 4, 16, 4, 5, 50, true},
    };
    for (const WalkCase& test : table) {
        SCOPED_TRACE(std::string(test.motion) + " " + std::to_string(test.cameras));
        studio::StudioOptions options;
        options.motion = test.motion, options.cameras = test.cameras, options.width = 480,
        options.height = 360;
        options.distortion = 0.05, options.fps = test.frames / test.seconds;
        const auto studio = *studio::Studio::create(options);
        SilhouetteSet set;
        for (int frame = 0; frame < test.frames; ++frame) {
            set.frame_sets.emplace_back();
            for (auto& mask : studio->masks(frame)) set.frame_sets.back().push_back({std::move(mask), false});
        }
        const auto floor = floor_from_person(in_old(studio->cameras()), set);
        ASSERT_TRUE(floor.ok()) << floor.status();
        const WorldError error = error_of(*floor);
        RecordProperty("tilt_deg", std::to_string(error.tilt_deg));
        printf("%s, %d cameras: tilt %.2f degrees (said: %.2f), height %+.0f mm\n", test.motion, test.cameras,
               error.tilt_deg, *floor->tilt_std_deg, error.height_mm);
        EXPECT_LT(error.tilt_deg, test.max_tilt_deg);
        EXPECT_LT(std::abs(error.height_mm), test.max_mm);
        bool narrow = false;
        for (const Finding& finding : floor->findings) narrow = narrow || finding.check == "walk_too_narrow";
        EXPECT_EQ(narrow, test.narrow);
        std::vector<Camera> cameras = in_old(studio->cameras());
        move_cameras({1, floor->world_from_old}, cameras);
        EXPECT_TRUE(check_world(cameras, std::nullopt, std::nullopt).empty());
    }
}

TEST(Floor, RefusesAnEmptySession) {
    SilhouetteSet set;
    for (int m = 0; m < 20; ++m) set.frame_sets.emplace_back(4);
    EXPECT_EQ(floor_from_person(ring(4), set).status().code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_EQ(
        floor_from_person(ring(4), set, {}, [](double, const std::string&) { return false; }).status().code(),
        absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace kinevox
