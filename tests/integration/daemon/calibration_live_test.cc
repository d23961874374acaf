// Calibrating a real daemon with what its cameras see meanwhile, in the virtual studio: a wand that is waved,
// a walking person; a moved camera; and observations rejected because of a limit.
#include "common/calibration_file.h"
#include "common/geometry.h"
#include "common/session_file.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/procedure/calibration_store.h"
#include "server/cameras/studio/staging.h"
#include "server/cameras/studio/studio.h"
#include "tests/integration/daemon/calibration_operator.h"
#include "tests/integration/daemon/daemon_fixture.h"

namespace kinevox {
namespace {

using ::testing::AllOf;
using testing::collecting;
using ::testing::HasSubstr;
using testing::must;
using testing::Operator;
using testing::over;
using testing::wait_until_running;

constexpr double kFps = 10;
constexpr int kEmptyFrames = 30;  // at the wand session's begin

struct StudioSession {
    std::vector<Camera> truth;
    std::filesystem::path session;
};

// Images of the studio, `empty_frames` of the empty room first; its calibration says `published` of the
// true cameras.
StudioSession write_studio_session(const std::filesystem::path& folder, const studio::StudioOptions& options,
                                   int empty_frames, int frames,
                                   const std::function<void(std::vector<Camera>&)>& published) {
    auto studio = studio::Studio::create(options);
    must(studio.status());
    StudioSession out{(*studio)->cameras(), folder / "session.toml"};
    Session session{"studio", options.fps, folder / "calibration.toml", {}, {}};
    for (std::size_t c = 0; c < out.truth.size(); ++c) {
        const auto images = folder / out.truth[c].name, empty_room = folder / (out.truth[c].name + "_empty");
        for (int i = 0; i < std::max(empty_frames, 8); ++i)
            testing::write_image((*studio)->draw_empty(c, i), empty_room / fmt::format("{:04}.ppm", i));
        for (int i = 0; i < empty_frames; ++i) {
            std::filesystem::create_directories(images);
            std::filesystem::create_symlink(empty_room / fmt::format("{:04}.ppm", i),
                                            images / fmt::format("{:04}.ppm", i));
        }
        session.cameras.push_back({out.truth[c].name, images, empty_room});
    }
    for (int frame = 0; frame < frames; ++frame) {
        const auto images = (*studio)->draw(frame, true);
        for (std::size_t c = 0; c < images.size(); ++c)
            testing::write_image(images[c],
                                 session.cameras[c].video / fmt::format("{:04}.ppm", empty_frames + frame));
    }
    std::vector<Camera> cameras = out.truth;
    published(cameras);
    must(write_calibration_toml(cameras, session.calibration));
    must(write_session(session, out.session));
    return out;
}

studio::StudioOptions small_studio(int width, int height) {
    studio::StudioOptions options;
    options.width = width, options.height = height, options.fps = kFps;
    return options;
}

// Of the second camera as seen from the first, degrees.
double second_from_first_error_deg(const std::vector<Camera>& cameras, const std::vector<Camera>& truth) {
    const auto turn = [](const std::vector<Camera>& from) {
        return from[1].camera_from_world.rotation * from[0].camera_from_world.rotation.transposed();
    };
    return degrees(angle_between(turn(cameras), turn(truth)));
}

class LiveCalibrationTest : public testing::DaemonTest {
  protected:
    static void SetUpTestSuite() { shared_ = new testing::TemporaryFolder; }

    static std::filesystem::path folder(const std::string& name) { return shared_->path() / name; }

    // Once for all tests.
    static const StudioSession& wand() {
        static const StudioSession session = [] {
            studio::StudioOptions options = small_studio(400, 300);
            options.staging.person = false;
            options.staging.wand = studio::StagedWand{{0, 0.2, 0.6}};
            return write_studio_session(
                folder("wand"), options, kEmptyFrames, 80, [](std::vector<Camera>& cameras) {
                    for (Camera& camera : cameras)
                        camera = studio::bumped_camera(camera, {0, 0.004, 0}, {0.01, 0, 0});
                });
        }();
        return session;
    }

    std::unique_ptr<testing::ChildProcess> start_on(const StudioSession& session,
                                                    const std::string& source = "") {
        session_ = session.session;
        return start_daemon(
            session_config("127.0.0.1:0", source, "enabled = false\ndatabase_file = \"\"") +
            "[calibration]\nfolder = \"calibrations\"\n[pipeline]\nvoxel_mm = 40\ncolouring = false\n");
    }
};

TEST_F(LiveCalibrationTest, SolvesAndAppliesExtrinsicsFromWand) {
    const auto daemon = start_on(wand(), "autostart = false\n");
    Operator coach(address_);
    ASSERT_TRUE(coach.start(v1::PROCEDURE_KIND_EXTRINSICS_WAND).ok());
    EXPECT_REFUSED(coach.take(v1::LiveObservations::STEP_EMPTY_SCENE), kFailedPrecondition, "not running");
    ASSERT_TRUE(coach.client().start(client::Lease{coach.lease()}).ok());
    ASSERT_TRUE(coach.take(v1::LiveObservations::STEP_EMPTY_SCENE).ok());
    coach.wait([](const auto& progress) { return !progress.collecting_live(); });
    ASSERT_TRUE(coach.take(v1::LiveObservations::STEP_MOVING_TARGET).ok());
    v1::WatchProcedureResponse seen =
        coach.wait([](const auto& progress) { return progress.shared_frame_set_count() >= 50; });
    for (const v1::CameraObservations& camera : seen.cameras())
        EXPECT_GT(camera.accepted_count(), 20) << camera.name();
    ASSERT_TRUE(coach.solve().ok());
    seen = coach.wait([](const auto& progress) { return over(progress) || collecting(progress); });
    ASSERT_EQ(seen.state(), v1::PROCEDURE_STATE_SOLVED) << seen.message();
    EXPECT_NE(seen.verdict(), v1::VERDICT_NO_GO);

    // Floor and origin are those of the active calibration; the relative extrinsics are the wand's.
    const auto applied = coach.apply(seen.calibration_id(), true);
    ASSERT_TRUE(applied.ok()) << applied.status();
    EXPECT_TRUE(applied->active());
    EXPECT_EQ(coach.client().status()->active_calibration_id(), seen.calibration_id());
    const std::vector<Camera> cameras = *coach.client().cameras();
    std::vector<Vec3> found, right;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        found.push_back(cameras[c].centre_in_world());
        right.push_back(wand().truth[c].centre_in_world());
        EXPECT_LT(norm(found[c] - right[c]), 0.06) << c;
    }
    const SimilarityTransform aligned = *align_points(found, right, false);
    for (std::size_t c = 0; c < cameras.size(); ++c) EXPECT_LT(norm(aligned(found[c]) - right[c]), 0.01) << c;
    wait_until_running(coach.client());
}

// A camera was turned by half a degree after it was calibrated, and the background was learned again since.
TEST_F(LiveCalibrationTest, RefinesMovedCameraFromPerson) {
    const StudioSession session =
        write_studio_session(folder("walk"), small_studio(400, 300), 0, 60, [](std::vector<Camera>& cameras) {
            cameras[1] = studio::bumped_camera(cameras[1], {0.006, 0.006, 0}, {});
        });
    const auto daemon = start_on(session);
    Operator coach(address_);
    wait_until_running(coach.client());
    const std::vector<Camera> before = *coach.client().cameras();
    EXPECT_GT(second_from_first_error_deg(before, session.truth), 0.4);
    ASSERT_TRUE(coach.start(v1::PROCEDURE_KIND_EXTRINSICS_REFINE_PERSON).ok());
    ASSERT_TRUE(coach.take(v1::LiveObservations::STEP_MOVING_TARGET).ok());
    // As many as the procedure asks for.
    v1::WatchProcedureResponse seen =
        coach.wait([](const auto& progress) { return progress.shared_frame_set_count() >= 48; });
    ASSERT_TRUE(coach.solve().ok());
    seen = coach.wait([](const auto& progress) { return over(progress) || collecting(progress); });
    ASSERT_EQ(seen.state(), v1::PROCEDURE_STATE_SOLVED) << seen.message();
    const bool bad = seen.verdict() == v1::VERDICT_NO_GO;
    const auto applied = coach.apply(seen.calibration_id(), true, bad);
    ASSERT_TRUE(applied.ok()) << applied.status();
    EXPECT_LT(second_from_first_error_deg(*coach.client().cameras(), session.truth), 0.2);
    ASSERT_TRUE(coach.undo(true).ok());
    EXPECT_EQ(*coach.client().cameras(), before);
}

TEST_F(LiveCalibrationTest, ReportsMovedCameraUntilRestored) {
    constexpr std::size_t kMoved = 2;
    constexpr int kFrames = 60, kBumpFrame = 20;
    studio::StudioOptions options = small_studio(320, 240);
    options.staging.bump = studio::CameraBump{kMoved, kBumpFrame / kFps, 0.5};
    // When the recording restarts, the camera is back in its position.
    const StudioSession session =
        write_studio_session(folder("bump"), options, 0, kFrames, [](std::vector<Camera>&) {});
    const auto daemon = start_on(session);
    Operator coach(address_);
    const std::string name = session.truth[kMoved].name;
    v1::Event moved, back;
    v1::GetStatusResponse while_moved;
    v1::WatchEventsRequest past;
    past.set_history_count(50);
    const absl::Status watched = coach.client().watch_events(
        past,
        [&](const v1::WatchEventsResponse& message) {
            const v1::Event& event = message.event();
            EXPECT_TRUE(event.camera().empty() || event.camera() == name) << event.message();
            if (event.kind() == v1::EVENT_KIND_CAMERA_MOVED && moved.message().empty()) {
                moved = event;
                const auto status = coach.client().status();
                EXPECT_TRUE(status.ok()) << status.status();
                while_moved = status.value_or(v1::GetStatusResponse());
            }
            if (event.kind() == v1::EVENT_KIND_CAMERA_MOVE_CLEARED) back = event;
            return back.message().empty();
        },
        {.idle_timeout = std::chrono::seconds(30)});
    ASSERT_TRUE(watched.ok()) << watched;
    EXPECT_THAT(moved.message(),
                AllOf(HasSubstr(name), HasSubstr("has moved"), HasSubstr("calibrate refine")));
    EXPECT_GE(moved.sequence(), kBumpFrame);
    EXPECT_LE(moved.sequence(), kBumpFrame + testing::patient(10) * kFps);
    EXPECT_GT(back.sequence(), moved.sequence());
    for (const v1::CameraStatus& camera : while_moved.cameras()) {
        EXPECT_EQ(camera.calibration_suspect(), camera.name() == name) << camera.name();
        EXPECT_EQ(camera.calibration_suspect_reason().empty(), camera.name() != name);
    }
    const auto afterwards = coach.client().status();
    ASSERT_TRUE(afterwards.ok()) << afterwards.status();
    for (const v1::CameraStatus& camera : afterwards->cameras())
        EXPECT_FALSE(camera.calibration_suspect()) << camera.name();
}

TEST_F(LiveCalibrationTest, RejectsObservationsWithoutRoom) {
    const auto daemon = start_on(wand(), "autostart = false\n");
    Operator coach(address_);
    // More frame sets than the maximum: the images of the wand repeatedly.
    v1::AddObservationsRequest clips;
    clips.set_lease_id(coach.lease());
    for (int c = 0; c < 2; ++c) {
        const std::string& name = wand().truth[c].name;
        const std::filesystem::path many = folder_.path() / name;
        std::filesystem::create_directory(many);
        for (int i = 0; i < 2500; ++i)
            std::filesystem::create_symlink(
                session_.parent_path() / name / fmt::format("{:04}.ppm", kEmptyFrames + i % 80),
                many / fmt::format("{:05}.ppm", i));
        v1::CameraClip& clip = *clips.mutable_files()->add_clips();
        clip.set_camera(name);
        clip.set_path(many.string());
    }
    ASSERT_TRUE(coach.start(v1::PROCEDURE_KIND_EXTRINSICS_WAND).ok());
    ASSERT_TRUE(coach.client().add_observations(clips).ok());
    coach.wait(collecting);
    EXPECT_REFUSED(coach.client().add_observations(clips), kResourceExhausted, "solve, or start again");
    ASSERT_TRUE(coach.client().start(client::Lease{coach.lease()}).ok());
    EXPECT_REFUSED(coach.take(v1::LiveObservations::STEP_EMPTY_SCENE), kResourceExhausted,
                   "solve, or start again");
    ASSERT_TRUE(coach.cancel().ok());

    // More calibrations than are stored.
    const std::string own = *coach.export_as("", v1::CALIBRATION_FORMAT_TOML);
    ASSERT_EQ(*coach.import(own, v1::CALIBRATION_FORMAT_TOML), "c1");
    const std::filesystem::path stored = folder_.path() / "calibrations";
    for (std::size_t i = 2; i <= CalibrationStore::kMaxCalibrations; ++i)
        std::filesystem::copy(stored / "c1", stored / fmt::format("c{}", i),
                              std::filesystem::copy_options::recursive);
    EXPECT_EQ(coach.list().calibrations_size(), static_cast<int>(CalibrationStore::kMaxCalibrations));
    EXPECT_REFUSED(coach.import(own, v1::CALIBRATION_FORMAT_TOML), kResourceExhausted, "delete some");
    v1::DeleteCalibrationRequest remove;
    remove.set_lease_id(coach.lease());
    remove.set_calibration_id("c7");
    ASSERT_TRUE(coach.client().delete_calibration(remove).ok());
    EXPECT_TRUE(coach.import(own, v1::CALIBRATION_FORMAT_TOML).ok());
}

}  // namespace
}  // namespace kinevox
