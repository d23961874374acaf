// The parts of the viewer that need neither display nor daemon.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "client/viewer/calibration.h"
#include "client/viewer/curves.h"
#include "client/viewer/feed.h"
#include "client/viewer/ghost_match.h"
#include "client/viewer/scene_painter.h"
#include "client/viewer/shown.h"
#include "client/viewer/subjects.h"
#include "common/body_pose.h"
#include "common/proto_time.h"

namespace kinevox::viewer {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::IsNan;
using ::testing::Not;
using ::testing::Pair;

QVector3D on_screen(const OrbitCamera& eye, const QVector3D& point) {
    return (eye.clip_from_eye(1.6f) * eye.eye_from_world()).map(point);
}

TEST(OrbitCamera, CentresTargetFromEverySide) {
    for (const View view : {View::kFront, View::kSide, View::kTop, View::kOblique}) {
        OrbitCamera eye;
        eye.look_from(view);
        const QVector3D centre = on_screen(eye, eye.target_in_world);
        EXPECT_NEAR(centre.x(), 0, 1e-4);
        EXPECT_NEAR(centre.y(), 0, 1e-4);
        EXPECT_GT(on_screen(eye, eye.target_in_world + QVector3D(0, 0, 0.5f)).y(), 0) << "z is up";
    }
}

TEST(OrbitCamera, PansWithThePointer) {
    OrbitCamera eye;
    const QVector3D point = eye.target_in_world;
    constexpr float kHeight_px = 800, kRight_px = 120, kDown_px = 50;
    eye.pan(kRight_px, kDown_px, kHeight_px);
    const QVector3D at = on_screen(eye, point);
    EXPECT_NEAR(at.x() * 1.6f * kHeight_px / 2, kRight_px, 1);
    EXPECT_NEAR(-at.y() * kHeight_px / 2, kDown_px, 1);
}

TEST(OrbitCamera, StaysWithinLimits) {
    OrbitCamera eye;
    eye.orbit(0, 1e6f);
    EXPECT_FLOAT_EQ(eye.elevation_deg, OrbitCamera::kMaxElevation_deg);
    eye.zoom(1e4f);
    EXPECT_FLOAT_EQ(eye.distance_m, OrbitCamera::kMinDistance_m);
    eye.zoom(-1e4f);
    EXPECT_FLOAT_EQ(eye.distance_m, OrbitCamera::kMaxDistance_m);
}

TEST(OrbitCamera, FollowsWithoutOvershoot) {
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
                VolumeBrick brick{static_cast<std::int16_t>(bx),
                                  static_cast<std::int16_t>(by),
                                  static_cast<std::int16_t>(bz),
                                  {}};
                bool any = false;
                for (int z = 0; z < 8; ++z)
                    for (int bit = 0; bit < 64; ++bit) {
                        const Vec3 from_centre{8.0 * bx + bit % 8 - 19.5, 8.0 * by + bit / 8 - 19.5,
                                               8.0 * bz + z - 19.5};
                        if (norm(from_centre) > radius_voxels) continue;
                        brick.occupancy[static_cast<std::size_t>(z)] |= std::uint64_t{1} << bit;
                        any = true;
                    }
                if (any) volume.bricks.push_back(brick);
            }
    return volume;
}

TEST(SurfacePoints, HaveOutwardNormalsOnABall) {
    const Volume volume = ball(14);
    const std::vector<SurfacePoint> points = surface_points(volume);
    ASSERT_EQ(points.size(), surface_voxels(volume).size());
    const Vec3 centre = volume.grid.origin_in_world + Vec3{0.4, 0.4, 0.4};
    double worst = 1;
    for (const SurfacePoint& p : points) {
        const Vec3 outwards = Vec3{p.x, p.y, p.z} - centre;
        EXPECT_NEAR(norm(outwards), 14 * 0.02, 0.03);
        worst =
            std::min(worst, dot(normalized(outwards), normalized(Vec3{1.0 * p.nx, 1.0 * p.ny, 1.0 * p.nz})));
    }
    EXPECT_GT(worst, std::cos(20 * M_PI / 180));
}

TEST(SurfacePoints, HandleOneVoxelAndNone) {
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
    p.angles = {{"knee_flexion_geometric_l", left},
                {"knee_flexion_geometric_r", right},
                {"trunk_lean_geometric", 3.0}};
    return p;
}

TEST(AngleHistory, KeepsLatestSecondsWithGaps) {
    AngleHistory history;
    for (int n = 0; n < 100; ++n) history.add(pose(0.5 * n, n, n == 99 ? std::nullopt : std::optional(50.0)));
    const auto series = history.series("knee_flexion_geometric_l");
    ASSERT_EQ(series.time_s.size(), 61U);  // 30 s and the latest
    EXPECT_DOUBLE_EQ(series.time_s.back(), 0);
    EXPECT_DOUBLE_EQ(series.value_deg.back(), 99);
    EXPECT_TRUE(std::isnan(history.series("knee_flexion_geometric_r").value_deg.back()));
    EXPECT_FALSE(history.latest_deg("knee_flexion_geometric_r"));
    EXPECT_FALSE(history.left_over_right("knee_flexion_geometric_l"));
    EXPECT_EQ(AngleHistory::opposite_side("knee_flexion_geometric_l"), "knee_flexion_geometric_r");
    EXPECT_THAT(AngleHistory::opposite_side("trunk_lean_geometric"), IsEmpty());
    EXPECT_THAT(history.series("no_such_angle").time_s, IsEmpty());
}

TEST(AngleHistory, ResetsAfterSeekAndComputesRatio) {
    AngleHistory history;
    history.add(pose(10, 40, 50));
    history.add(pose(11, 40, 50));
    EXPECT_DOUBLE_EQ(history.left_over_right("knee_flexion_geometric_r").value(), 0.8);
    history.add(pose(4, 40, 2));
    EXPECT_EQ(history.series("knee_flexion_geometric_l").time_s.size(), 1U);
    EXPECT_FALSE(history.left_over_right("knee_flexion_geometric_l")) << "no ratio to almost zero";
}

constexpr const char* kKnee = "knee_flexion_geometric_l";

// The angle of each subject is its id.
ShownPoses poses_of(double time_s, const std::vector<std::uint32_t>& ids) {
    ShownPoses poses;
    poses.capture_time_ns = static_cast<std::int64_t>(time_s * 1e9);
    for (const std::uint32_t id : ids) {
        poses.subjects.push_back(pose(time_s, id, 50.0));
        poses.subjects.back().subject_id = id;
    }
    return poses;
}

TEST(Subjects, AreOneHistoryWhileAlone) {
    Subjects subjects;
    EXPECT_EQ(subjects.selected(), 0U);
    subjects.add(poses_of(1, {1}));
    subjects.add(poses_of(2, {}));
    subjects.add(poses_of(3, {2}));
    EXPECT_EQ(subjects.selected(), 2U);
    EXPECT_FALSE(subjects.several());
    const auto series = subjects.history().series(kKnee);
    EXPECT_THAT(series.value_deg, ElementsAre(1, IsNan(), 2)) << "one curve";
    subjects.select(7);
    EXPECT_EQ(subjects.selected(), 2U) << "there is nothing to select";
}

TEST(Subjects, KeepSelectionThroughShortLoss) {
    Subjects subjects;
    subjects.add(poses_of(1, {1}));
    subjects.add(poses_of(2, {1, 2}));
    EXPECT_TRUE(subjects.several());
    EXPECT_EQ(subjects.selected(), 1U);
    EXPECT_EQ(subjects.history().series(kKnee).value_deg.size(), 2U) << "its curve from when it was alone";
    subjects.select(2);
    for (double t = 3; t < 2 + Subjects::kPatience_s; ++t) subjects.add(poses_of(t, {1}));
    EXPECT_EQ(subjects.selected(), 2U) << "lost briefly";
    EXPECT_FALSE(subjects.history().latest_deg(kKnee)) << "never the angles of the other";
    EXPECT_EQ(subjects.history(1).latest_deg(kKnee), 1);
    subjects.add(poses_of(2.5 + Subjects::kPatience_s, {1}));
    EXPECT_EQ(subjects.selected(), 1U) << "gone";
    EXPECT_FALSE(subjects.several());
    EXPECT_EQ(subjects.history().latest_deg(kKnee), 1);
    subjects.add(poses_of(9, {1, 2}));
    EXPECT_EQ(subjects.selected(), 2U) << "it returned";
}

TEST(Subjects, SelectAmongNewOnesAfterResetOfTracking) {
    Subjects subjects;
    subjects.add(poses_of(1, {1, 2}));
    subjects.select(2);
    subjects.add(poses_of(2, {2, 3}));
    EXPECT_EQ(subjects.selected(), 2U);
    subjects.add(poses_of(3, {4, 5}));
    EXPECT_EQ(subjects.selected(), 4U);
    EXPECT_THAT(subjects.ids(), ElementsAre(4, 5));
    EXPECT_EQ(subjects.history().latest_deg(kKnee), 4);
}

TEST(Subjects, CompareAnotherUntilItIsGone) {
    Subjects subjects;
    subjects.add(poses_of(1, {1, 2, 3}));
    EXPECT_FALSE(subjects.compared());
    subjects.compare(3);
    EXPECT_EQ(subjects.compared(), 3U);
    subjects.select(3);
    EXPECT_FALSE(subjects.compared()) << "with itself";
    subjects.select_next();
    EXPECT_EQ(subjects.selected(), 1U) << "after the last the first";
    EXPECT_EQ(subjects.compared(), 3U);
    for (double t = 2; t < 10; ++t) subjects.add(poses_of(t, {1, 2}));
    EXPECT_FALSE(subjects.compared());
    EXPECT_THAT(subjects.ids(), ElementsAre(1, 2));
    subjects.add(poses_of(3, {2}));
    EXPECT_EQ(subjects.history(2).series(kKnee).time_s.size(), 1U) << "after a seek";
}

TEST(Subjects, HaveDifferentColoursThatStay) {
    Subjects subjects;
    subjects.add(poses_of(1, {3, 4, 12}));
    EXPECT_THAT(subjects.colours(), ElementsAre(Pair(3, 3), Pair(4, 4), Pair(12, 5)));
    for (double t = 2; t < 2 + 2 * Subjects::kPatience_s; ++t) subjects.add(poses_of(t, {12, 13}));
    EXPECT_THAT(subjects.colours(), ElementsAre(Pair(12, 5), Pair(13, 6)));
    subjects.add(poses_of(20, {1, 2, 3, 4, 5, 6, 7, 8, 9}));
    EXPECT_EQ(subjects.colours().at(9), 1U) << "more than there are colours";
}

TEST(Subjects, AreListedWithLatestNames) {
    Subjects subjects;
    for (const std::size_t count : {0, 1, 2, 4}) {
        subjects.clear();
        std::vector<std::uint32_t> ids{1, 2, 3, 4};
        ids.resize(count);
        ShownPoses poses = poses_of(1, ids);
        for (ShownPose& pose : poses.subjects) pose.subject_name = pose.subject_id == 2 ? "" : "Anna";
        subjects.add(poses);
        EXPECT_EQ(subjects.ids(), ids);
        for (const std::uint32_t id : ids) EXPECT_EQ(subjects.name_of(id), id == 2 ? "" : "Anna");
    }
    ShownPoses renamed = poses_of(2, {1, 2});
    renamed.subjects[1].subject_name = "Jörg";
    subjects.add(renamed);
    EXPECT_EQ(subjects.name_of(1), "") << "removed";
    EXPECT_EQ(subjects.name_of(2), "Jörg");
    EXPECT_EQ(subjects.name_of(4), "Anna") << "lost briefly";
    subjects.add(poses_of(3 + Subjects::kPatience_s, {1}));
    EXPECT_EQ(subjects.name_of(4), "") << "gone";
}

TEST(SubjectAt, FindsNearestSubjectUnderPointer) {
    const OrbitCamera eye;
    ShownVolume volume;
    const auto add = [&](std::uint32_t id, const QVector3D& at) {
        volume.subjects.push_back({id, volume.points.size(), 1, {}});
        volume.points.push_back({at.x(), at.y(), at.z()});
    };
    const QVector3D towards = (eye.eye_in_world() - eye.target_in_world).normalized();
    add(4, eye.target_in_world - towards);
    add(5, eye.target_in_world + towards);
    add(6, eye.target_in_world + 10 * towards);  // behind the eye
    const QMatrix4x4 clip_from_world = eye.clip_from_eye(1.6f) * eye.eye_from_world();
    std::array<double, 16> rows{};
    for (std::size_t n = 0; n < 16; ++n)
        rows[n] = clip_from_world(static_cast<int>(n / 4), static_cast<int>(n % 4));
    EXPECT_EQ(subject_at({400, 250, 800, 500}, rows, &volume, nullptr), 5U) << "in front";
    EXPECT_FALSE(subject_at({430, 250, 800, 500}, rows, &volume, nullptr));
    ShownPoses poses = poses_of(1, {8});
    EXPECT_FALSE(subject_at({400, 250, 800, 500}, rows, nullptr, &poses)) << "no joints";
    poses.subjects[0].joints_in_world[0] = Vec3{0, 0, 0.95};
    EXPECT_EQ(subject_at({400, 250, 800, 500}, rows, nullptr, &poses), 8U);
}

ConnectionStatus connected() {
    ConnectionStatus connection;
    connection.server = "hall:50770";
    connection.connected = true;
    return connection;
}

v1::GetStatusResponse running() {
    v1::GetStatusResponse status;
    status.set_state(v1::CAPTURE_STATE_RUNNING);
    status.set_nominal_fps(50);
    status.set_result_count(1000);
    status.set_result_rate_hz(50);
    for (const char* name : {"cam1", "cam2"}) {
        v1::CameraStatus* camera = status.add_cameras();
        camera->set_name(name);
        camera->set_has_image(true);
        camera->add_subjects()->set_used(true);
    }
    return status;
}

TEST(DescribeStatus, ReportsNoProblem) {
    ConnectionStatus connection = connected();
    connection.latency_ms = 61.2;
    v1::GetStatusResponse status = running();
    v1::SubjectStatus& subject = *status.add_subjects();
    subject.mutable_subject()->set_subject_id(1);
    subject.mutable_volume()->set_volume_litres(71.6);
    const StatusText text = describe_status(connection, &status, nullptr, nullptr);
    EXPECT_EQ(text.severity, Severity::kOk);
    EXPECT_EQ(text.state, "Live");
    EXPECT_EQ(text.line, "50 frames per second  ·  latency 61 ms  ·  2 cameras  ·  72 litres");
    EXPECT_THAT(text.remedy, IsEmpty());
}

TEST(DescribeStatus, NamesProblemsWithRemedies) {
    v1::GetStatusResponse status = running();
    EXPECT_THAT(describe_status(connected(), &status, nullptr, nullptr).line, HasSubstr("no subject"));

    ConnectionStatus gone = connected();
    gone.connected = false;
    gone.error_message = "cannot connect to hall:50770";
    EXPECT_EQ(describe_status(gone, &status, nullptr, nullptr).severity, Severity::kError);
    EXPECT_THAT(describe_status(gone, &status, nullptr, nullptr).remedy, HasSubstr("reconnecting"));

    ConnectionStatus idle = connected();
    idle.idle_s = 4;
    EXPECT_THAT(describe_status(idle, &status, nullptr, nullptr).remedy, HasSubstr("check the network"));
    v1::Replay paused;
    paused.set_state(v1::REPLAY_STATE_PAUSED);
    EXPECT_EQ(describe_status(idle, &status, nullptr, &paused).state, "Replay, paused");

    status.mutable_cameras(1)->set_has_image(false);
    EXPECT_THAT(describe_status(connected(), &status, nullptr, nullptr).remedy,
                HasSubstr("cam2 delivers no image"));
    EXPECT_THAT(describe_status(connected(), &status, nullptr, nullptr).line, HasSubstr("1 of 2 cameras"));
    status.mutable_cameras(1)->mutable_connection()->set_error_message("unplugged; check its cable");
    EXPECT_THAT(describe_status(connected(), &status, nullptr, nullptr).remedy, HasSubstr("check its cable"));

    status = running();
    status.set_result_rate_hz(20);
    EXPECT_THAT(describe_status(connected(), &status, nullptr, nullptr).remedy,
                HasSubstr("processes 20 of 50"));
    status.set_state(v1::CAPTURE_STATE_STOPPED);
    EXPECT_THAT(describe_status(connected(), &status, nullptr, nullptr).remedy, HasSubstr("press Start"));
    EXPECT_THAT(describe_status(connected(), &status, nullptr, nullptr).line, Not(HasSubstr("per second")));
}

TEST(DescribeStatus, WarnsOfDroppedFrames) {
    const v1::GetStatusResponse status = running();
    v1::GetRecorderStatusResponse recorder;
    recorder.mutable_current()->set_name("jump");
    *recorder.mutable_current()->mutable_duration() = duration_from_s(12.4);
    EXPECT_THAT(describe_status(connected(), &status, &recorder, nullptr).line,
                HasSubstr("recording \"jump\" 12 s"));
    recorder.mutable_current()->set_dropped_frame_set_count(3);
    EXPECT_EQ(describe_status(connected(), &status, &recorder, nullptr).severity, Severity::kWarning);
}

constexpr double kTrial_hz = 50;

// A person walks along x; the left foot is in the air from 1.0 to 1.4 s, the right one from 1.6 to 2.0 s.
GhostTrial walk(const std::string& name) {
    GhostTrial trial{name, {}};
    const auto foot = [](double t, double lift_s, double from_m) {
        const double fraction = std::clamp((t - lift_s) / 0.4, 0.0, 1.0);
        return Vec3{from_m + 0.8 * fraction, 0, 0.08 + 0.15 * std::sin(M_PI * fraction)};
    };
    for (int n = 0; n < 150; ++n) {
        const double t = n / kTrial_hz;
        GhostInstant instant{t, {}};
        instant.joints_in_world[*joint_index("root")] = Vec3{0.3 * t, 0, 0.9 + 0.05 * std::sin(2 * t)};
        instant.joints_in_world[*joint_index("ankle_l")] = foot(t, 1.0, 0);
        instant.joints_in_world[*joint_index("ankle_r")] = foot(t, 1.6, 0.4);
        trial.instants.push_back(instant);
    }
    return trial;
}

TEST(GhostTrial, FindsEvents) {
    const GhostTrial trial = walk("a");
    EXPECT_EQ(trial.time_of(TrialEvent::kBegin), 0);
    EXPECT_NEAR(trial.time_of(TrialEvent::kLeftFootDown).value(), 1.4, 0.05);
    EXPECT_NEAR(trial.time_of(TrialEvent::kRightFootDown).value(), 2.0, 0.05);
    EXPECT_NEAR(trial.time_of(TrialEvent::kHighestPoint).value(), M_PI / 4, 0.03);
    EXPECT_NEAR(trial.time_of(TrialEvent::kLowestPoint).value(), 3 * M_PI / 4, 0.03);
    EXPECT_FALSE(trial.time_of(TrialEvent::kMark));
    GhostTrial stands = trial;
    stands.instants.resize(40);
    EXPECT_FALSE(stands.time_of(TrialEvent::kLeftFootDown)) << "no step while standing";
}

TEST(GhostTrial, InterpolatesWithinItsFrames) {
    const GhostTrial trial = walk("a");
    EXPECT_NEAR(trial.at(0.51).value()[*joint_index("root")]->x, 0.3 * 0.51, 1e-9);
    EXPECT_FALSE(trial.at(0.5).value()[*joint_index("elbow_l")]) << "withheld";
    EXPECT_FALSE(trial.at(-0.01));
    EXPECT_FALSE(trial.at(3.0));
}

TEST(GhostTrial, ParsesJointsAndExportTables) {
    for (const std::string unit : {"", "_m"}) {
        std::string csv = "frame,time_s";
        for (const std::string_view joint : kJointNames)
            for (const char axis : {'x', 'y', 'z'}) csv += fmt::format(",{}_{}{}", joint, axis, unit);
        csv += ",knee_flexion_geometric_l_deg\n";
        for (int n = 0; n < 3; ++n) {
            csv += fmt::format("{},{}", 10 + n, 0.2 + 0.02 * n);
            for (std::size_t cell = 0; cell < 3 * kJointNames.size(); ++cell)
                csv += cell < 3 ? ","
                                : fmt::format(",{}",
                                              0.1 * static_cast<double>(cell) + n);  // the first is withheld
            csv += ",12.5\n";
        }
        const auto trial = parse_ghost_trial(csv, "t");
        ASSERT_TRUE(trial.ok()) << trial.status();
        ASSERT_EQ(trial->instants.size(), 3U);
        EXPECT_NEAR(trial->instants[2].time_s, 0.04, 1e-9) << "since the first frame";
        EXPECT_FALSE(trial->instants[0].joints_in_world[0]);
        EXPECT_NEAR(trial->instants[1].joints_in_world[1]->y, 1.4, 1e-9);

        EXPECT_THAT(std::string(parse_ghost_trial(csv + "13,0.1\n", "t.csv").status().message()),
                    HasSubstr("t.csv, line 5"));
        EXPECT_THAT(std::string(parse_ghost_trial("frame,time_s,root_x\n", "t.csv").status().message()),
                    HasSubstr("no column root_y"));
    }
    EXPECT_FALSE(parse_ghost_trial("", "t.csv").ok());
}

ShownPose replayed_pose(std::int64_t frame) {
    ShownPose p;
    p.recorded_frame = frame;
    p.capture_time_ns = 1'700'000'000'000'000'000 + frame;
    p.joints_in_world[*joint_index("root")] = Vec3{5, 6, 1};
    return p;
}

TEST(GhostMatch, AlignsEventsOfReplayAndGhost) {
    GhostMatch match;
    const ShownPose at_frame_60 = replayed_pose(60);
    const double now_s = shown_time_s(at_frame_60, 30);
    EXPECT_DOUBLE_EQ(now_s, 2);
    EXPECT_FALSE(match.ghost_time_s(now_s)) << "without a ghost";
    match.set_ghost(std::make_shared<GhostTrial>(walk("ghost")));
    EXPECT_DOUBLE_EQ(match.ghost_time_s(now_s).value(), 2) << "both from their start";

    // The first left step of the replay is at 1.4 s, the first right one of the ghost at 2.0 s.
    match.set_shown(std::make_shared<GhostTrial>(walk("replayed")));
    match.set_events(TrialEvent::kRightFootDown, TrialEvent::kLeftFootDown);
    EXPECT_NEAR(match.ghost_time_s(1.4).value(), 2.0, 0.1);
    EXPECT_NEAR(match.ghost_time_s(1.4 + 1 / 30.).value() - match.ghost_time_s(1.4).value(), 1 / 30., 1e-9)
        << "a step";
    match.set_offset_s(0.25);
    EXPECT_NEAR(match.ghost_time_s(1.4).value(), 2.25, 0.1);

    // Another recording resets the mark.
    match.mark_shown(0.5);
    match.set_events(TrialEvent::kBegin, TrialEvent::kMark);
    match.set_offset_s(0);
    EXPECT_DOUBLE_EQ(match.ghost_time_s(0.7).value(), 0.2);
    match.set_shown(nullptr);
    EXPECT_FALSE(match.shown_event_s());
    EXPECT_THAT(match.problem(), HasSubstr("press M"));
    match.set_events(TrialEvent::kBegin, TrialEvent::kLeftFootDown);
    EXPECT_FALSE(match.ghost_time_s(1)) << "unknown event";
    EXPECT_THAT(match.problem(), HasSubstr("set a mark"));
}

TEST(GhostMatch, WaitsForMarkWhileLive) {
    GhostMatch match;
    match.set_ghost(std::make_shared<GhostTrial>(walk("ghost")));
    match.set_events(TrialEvent::kLeftFootDown, TrialEvent::kMark);
    const double now_s = 1e-9 * 1'700'000'000'000'000'000;
    EXPECT_NEAR(match.ghost_time_s(now_s).value(), 1.4, 0.05) << "stands at its event";
    EXPECT_DOUBLE_EQ(match.ghost_time_s(now_s + 5).value(), match.ghost_time_s(now_s).value());
    match.mark_shown(now_s + 5);
    EXPECT_NEAR(match.ghost_time_s(now_s + 5.3).value(), 1.7, 0.05);

    const ShownPose shown = replayed_pose(0);
    EXPECT_TRUE(match.pose(shown, now_s + 5.3).found);
    EXPECT_FALSE(match.pose(shown, now_s + 60).found) << "past its end";
    match.set_align_pelvis(true);
    const Vec3 root = *match.pose(shown, now_s + 5.3).joints_in_world[*joint_index("root")];
    EXPECT_DOUBLE_EQ(root.x, 5);
    EXPECT_DOUBLE_EQ(root.y, 6);
    EXPECT_NEAR(root.z, 0.9, 0.06) << "the height is the ghost's";
}

TEST(PlotMarks, KeepsRelevantEventsAndMarks) {
    PlotMarks marks;
    marks.add_event(v1::EVENT_KIND_SUBJECT_LOST, 100, 2);
    marks.add_event(v1::EVENT_KIND_CONTROL_ACQUIRED, 150);
    EXPECT_EQ(marks.add_mark(200), 1);
    EXPECT_EQ(marks.add_mark(300), 2);
    const auto seen = marks.between(100, 299);
    ASSERT_EQ(seen.size(), 2U);
    EXPECT_EQ(seen[0].text, "lost");
    EXPECT_EQ(seen[0].subject_id, 2U);
    EXPECT_EQ(seen[1].text, "mark 1");
    EXPECT_TRUE(seen[1].by_user);
    for (std::size_t n = 0; n < 2 * PlotMarks::kMaxMarks; ++n)
        marks.add_event(v1::EVENT_KIND_SUBJECT_FOUND, 1000);
    EXPECT_EQ(marks.between(0, 2000).size(), PlotMarks::kMaxMarks);
    marks.clear();
    EXPECT_EQ(marks.add_mark(1), 1);
}

TEST(CalibrationText, HasInstructionForEachStep) {
    for (const CalibrationKindText& kind : calibration_kinds())
        for (const CalibrationStep step :
             {CalibrationStep::kStarting, CalibrationStep::kEmptyScene, CalibrationStep::kBoardOnFloor,
              CalibrationStep::kMovingTarget, CalibrationStep::kSolving})
            EXPECT_THAT(instruction(kind.kind, step), Not(IsEmpty()));
    EXPECT_THAT(instruction(v1::PROCEDURE_KIND_EXTRINSICS_WAND, CalibrationStep::kMovingTarget),
                HasSubstr("wand"));
    EXPECT_THAT(instruction(v1::PROCEDURE_KIND_EXTRINSICS_REFINE_PERSON, CalibrationStep::kMovingTarget),
                HasSubstr("Walk"));
}

TEST(CalibrationText, FollowsProcedureOfAnotherClient) {
    v1::WatchProcedureResponse progress;
    EXPECT_EQ(step_of(progress), CalibrationStep::kNone);
    progress.set_state(v1::PROCEDURE_STATE_COLLECTING);
    EXPECT_EQ(step_of(progress), CalibrationStep::kStarting);
    progress.set_collecting_live(true);
    progress.set_live_step(v1::LiveObservations::STEP_BOARD_ON_FLOOR);
    EXPECT_EQ(step_of(progress), CalibrationStep::kBoardOnFloor);
    progress.set_state(v1::PROCEDURE_STATE_SOLVING);
    EXPECT_EQ(step_of(progress), CalibrationStep::kSolving);
    progress.set_state(v1::PROCEDURE_STATE_SOLVED);
    EXPECT_EQ(step_of(progress), CalibrationStep::kNone);
}

TEST(CalibrationText, ListsKnownCertificateValues) {
    v1::Certificate certificate;
    EXPECT_EQ(certificate_values(certificate).size(), 1U) << "the world frame only";
    certificate.set_held_out_reprojection_rms_px(0.371);
    certificate.set_scale_bias_mm_per_m(-1.26);
    const auto values = certificate_values(certificate);
    EXPECT_EQ(values[0].second, "0.37 px");
    EXPECT_EQ(values[1].second, "-1.3 mm per metre");
    v1::CertificateFinding finding;
    finding.set_camera("cam2");
    finding.set_reason("the camera has moved");
    finding.set_remedy("calibrate again");
    EXPECT_EQ(finding_line(finding), "camera cam2: the camera has moved; calibrate again");
}

}  // namespace
}  // namespace kinevox::viewer
