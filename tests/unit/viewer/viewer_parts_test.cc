// The viewer's parts that need neither a display nor a daemon.
#include <cmath>
#include <limits>

#include <gmock/gmock.h>

#include "client/viewer/angle_history.h"
#include "client/viewer/orbit_camera.h"
#include "client/viewer/status_words.h"
#include "client/viewer/volume_points.h"

namespace kinevox::viewer {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

QVector3D on_screen(const OrbitCamera& eye, const QVector3D& point) {
    return (eye.clip_from_eye(1.6f) * eye.eye_from_world()).map(point);
}

TEST(OrbitCameraTest, TheTargetIsInTheMiddleFromEverySide) {
    for (const Look from : {Look::kFront, Look::kSide, Look::kTop, Look::kOblique}) {
        OrbitCamera eye;
        eye.look(from);
        const QVector3D middle = on_screen(eye, eye.target_in_world);
        EXPECT_NEAR(middle.x(), 0, 1e-4);
        EXPECT_NEAR(middle.y(), 0, 1e-4);
        EXPECT_GT(on_screen(eye, eye.target_in_world + QVector3D(0, 0, 0.5f)).y(), 0) << "z is up";
    }
}

TEST(OrbitCameraTest, PanningMovesThePictureWithThePointer) {
    OrbitCamera eye;
    const QVector3D point = eye.target_in_world;
    constexpr float kHeight_px = 800, kRight_px = 120, kDown_px = 50;
    eye.pan(kRight_px, kDown_px, kHeight_px);
    const QVector3D at = on_screen(eye, point);
    EXPECT_NEAR(at.x() * 1.6f * kHeight_px / 2, kRight_px, 1);
    EXPECT_NEAR(-at.y() * kHeight_px / 2, kDown_px, 1);
}

TEST(OrbitCameraTest, StaysWithinItsLimits) {
    OrbitCamera eye;
    eye.orbit(0, 1e6f);
    EXPECT_FLOAT_EQ(eye.elevation_deg, OrbitCamera::kSteepest_deg);
    eye.zoom(1e4f);
    EXPECT_FLOAT_EQ(eye.distance_m, OrbitCamera::kNearest_m);
    eye.zoom(-1e4f);
    EXPECT_FLOAT_EQ(eye.distance_m, OrbitCamera::kFarthest_m);
}

TEST(OrbitCameraTest, FollowsWithoutOvershooting) {
    OrbitCamera eye;
    eye.target_in_world = {0, 0, 1};
    float before = 0;
    for (int n = 0; n < 100; ++n) {
        eye.follow({2, 0, 1}, 0.02f);
        EXPECT_GE(eye.target_in_world.x(), before);
        before = eye.target_in_world.x();
    }
    EXPECT_NEAR(before, 2, 0.01);
}

Volume ball(double radius_voxels) {
    Volume volume;
    volume.grid.origin_in_world = {1, -2, 0.5};
    volume.grid.voxel_m = 0.02;
    volume.grid.size = {40, 40, 40};
    for (int bz = 0; bz < 5; ++bz)
        for (int by = 0; by < 5; ++by)
            for (int bx = 0; bx < 5; ++bx) {
                VolumeBrick brick{static_cast<std::int16_t>(bx), static_cast<std::int16_t>(by), static_cast<std::int16_t>(bz), {}};
                bool any = false;
                for (int z = 0; z < 8; ++z)
                    for (int bit = 0; bit < 64; ++bit) {
                        const Vec3 from_middle{8.0 * bx + bit % 8 - 19.5, 8.0 * by + bit / 8 - 19.5, 8.0 * bz + z - 19.5};
                        if (norm(from_middle) > radius_voxels) continue;
                        brick.occupancy[static_cast<std::size_t>(z)] |= std::uint64_t{1} << bit;
                        any = true;
                    }
                if (any) volume.bricks.push_back(brick);
            }
    return volume;
}

TEST(SurfacePointsTest, LieOnABallAndLookOutwards) {
    const Volume volume = ball(14);
    const std::vector<SurfacePoint> points = surface_points(volume);
    ASSERT_EQ(points.size(), surface_voxels(volume).size());
    const Vec3 middle = volume.grid.origin_in_world + Vec3{0.4, 0.4, 0.4};
    double worst = 1;
    for (const SurfacePoint& p : points) {
        const Vec3 outwards = Vec3{p.x, p.y, p.z} - middle;
        EXPECT_NEAR(norm(outwards), 14 * 0.02, 0.03);
        worst = std::min(worst, dot(normalized(outwards), normalized(Vec3{1.0 * p.nx, 1.0 * p.ny, 1.0 * p.nz})));
    }
    EXPECT_GT(worst, std::cos(20 * M_PI / 180));
}

TEST(SurfacePointsTest, OneVoxelAndNone) {
    EXPECT_THAT(surface_points(Volume{}), IsEmpty());
    Volume one;
    one.grid.size = {8, 8, 8};
    one.bricks.push_back({0, 0, 0, {1}});
    one.colours = {{10, 20, 30}};
    const auto points = surface_points(one);
    ASSERT_EQ(points.size(), 1U);
    EXPECT_EQ(points[0].g, 20);
    EXPECT_FLOAT_EQ(points[0].x, 0.005f);
}

ShownPose pose(double time_s, std::optional<double> left, std::optional<double> right) {
    ShownPose p;
    p.capture_time_ns = static_cast<std::int64_t>(time_s * 1e9);
    p.angles = {{"knee_flexion_l", left}, {"knee_flexion_r", right}, {"trunk_lean", 3.0}};
    return p;
}

TEST(AngleHistoryTest, KeepsSidesGapsAndTheNewestSeconds) {
    AngleHistory history;
    for (int n = 0; n < 100; ++n) history.add(pose(0.5 * n, n, n == 99 ? std::nullopt : std::optional(50.0)));
    const auto series = history.series("knee_flexion_l");
    ASSERT_EQ(series.time_s.size(), 61U);   // 30 s and the newest
    EXPECT_DOUBLE_EQ(series.time_s.back(), 0);
    EXPECT_DOUBLE_EQ(series.value_deg.back(), 99);
    EXPECT_TRUE(std::isnan(history.series("knee_flexion_r").value_deg.back()));
    EXPECT_FALSE(history.newest_deg("knee_flexion_r"));
    EXPECT_FALSE(history.left_over_right("knee_flexion_l"));
    EXPECT_EQ(AngleHistory::other_side("knee_flexion_l"), "knee_flexion_r");
    EXPECT_THAT(AngleHistory::other_side("trunk_lean"), IsEmpty());
    EXPECT_THAT(history.series("no_such_angle").time_s, IsEmpty());
}

TEST(AngleHistoryTest, BeginsAnewAfterASeekAndSaysTheRatio) {
    AngleHistory history;
    history.add(pose(10, 40, 50));
    history.add(pose(11, 40, 50));
    EXPECT_DOUBLE_EQ(history.left_over_right("knee_flexion_r").value(), 0.8);
    history.add(pose(4, 40, 2));
    EXPECT_EQ(history.series("knee_flexion_l").time_s.size(), 1U);
    EXPECT_FALSE(history.left_over_right("knee_flexion_l")) << "a ratio to next to nothing says nothing";
}

Link connected() {
    Link link;
    link.server = "hall:50770";
    link.connected = true;
    return link;
}

v1::GetStatusResponse running() {
    v1::GetStatusResponse status;
    status.set_state(v1::CAPTURE_STATE_RUNNING);
    status.set_source_fps(50);
    status.set_results_per_second(50);
    for (const char* name : {"cam1", "cam2"}) {
        v1::CameraStatus* camera = status.add_cameras();
        camera->set_name(name);
        camera->set_has_picture(true);
        camera->set_used(true);
    }
    return status;
}

TEST(StatusWordsTest, AllIsWell) {
    Link link = connected();
    link.delay_ms = 61.2;
    v1::GetStatusResponse status = running();
    status.mutable_subject()->set_subject_id(1);
    status.mutable_volume()->set_litres(71.6);
    const Words words = in_words(link, &status, nullptr, nullptr);
    EXPECT_EQ(words.mood, Mood::kGood);
    EXPECT_EQ(words.state, "Live");
    EXPECT_EQ(words.line, "50 pictures a second  ·  61 ms behind  ·  2 cameras  ·  72 litres");
    EXPECT_THAT(words.remedy, IsEmpty());
}

TEST(StatusWordsTest, EachTroubleWithItsRemedy) {
    v1::GetStatusResponse status = running();
    EXPECT_THAT(in_words(connected(), &status, nullptr, nullptr).line, HasSubstr("nobody in sight"));

    Link gone = connected();
    gone.connected = false;
    gone.problem = "hall:50770 cannot be reached";
    EXPECT_EQ(in_words(gone, &status, nullptr, nullptr).mood, Mood::kBad);
    EXPECT_THAT(in_words(gone, &status, nullptr, nullptr).remedy, HasSubstr("trying again"));

    Link silent = connected();
    silent.silent_s = 4;
    EXPECT_THAT(in_words(silent, &status, nullptr, nullptr).remedy, HasSubstr("see to the network"));
    v1::Replay paused;
    paused.set_state(v1::REPLAY_STATE_PAUSED);
    EXPECT_EQ(in_words(silent, &status, nullptr, &paused).state, "Replay, paused");

    status.mutable_cameras(1)->set_has_picture(false);
    EXPECT_THAT(in_words(connected(), &status, nullptr, nullptr).remedy, HasSubstr("cam2 delivers no picture"));
    EXPECT_THAT(in_words(connected(), &status, nullptr, nullptr).line, HasSubstr("1 of 2 cameras"));
    status.mutable_cameras(1)->mutable_link()->set_problem("unplugged; look at its cable");
    EXPECT_THAT(in_words(connected(), &status, nullptr, nullptr).remedy, HasSubstr("look at its cable"));

    status = running();
    status.set_results_per_second(20);
    EXPECT_THAT(in_words(connected(), &status, nullptr, nullptr).remedy, HasSubstr("manages 20 of 50"));
    status.set_state(v1::CAPTURE_STATE_STOPPED);
    EXPECT_THAT(in_words(connected(), &status, nullptr, nullptr).remedy, HasSubstr("press Start"));
    EXPECT_THAT(in_words(connected(), &status, nullptr, nullptr).line, Not(HasSubstr("a second")));
}

TEST(StatusWordsTest, ARecordingThatLoses) {
    const v1::GetStatusResponse status = running();
    v1::GetRecorderStatusResponse recorder;
    recorder.mutable_recording()->set_name("jump");
    recorder.mutable_recording()->set_seconds(12.4);
    EXPECT_THAT(in_words(connected(), &status, &recorder, nullptr).line, HasSubstr("recording \"jump\" 12 s"));
    recorder.mutable_recording()->set_dropped(3);
    EXPECT_EQ(in_words(connected(), &status, &recorder, nullptr).mood, Mood::kCare);
}

}  // namespace
}  // namespace kinevox::viewer
