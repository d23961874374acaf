// CalibrationService of a real daemon, on a session in which a board is moved about in the virtual studio.
#include <gmock/gmock.h>
#include <signal.h>

#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "common/calibration_file.h"
#include "common/files.h"
#include "common/session_file.h"
#include "server/calibration/multi_view.h"
#include "tests/integration/daemon/board_session.h"
#include "tests/integration/daemon/calibration_operator.h"
#include "tests/integration/daemon/daemon_fixture.h"

namespace kinevox {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using testing::BoardSession;
using testing::collecting;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::kBoard;
using testing::kMoments;
using testing::must;
using testing::on_floor;
using testing::Operator;
using testing::over;
using testing::wait_until_running;
using testing::write_board_session;

// A file holds rotations as vectors, so that the last digit may change.
void expect_same(const std::vector<Camera>& a, const std::vector<Camera>& b) {
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t c = 0; c < a.size(); ++c) {
        EXPECT_EQ(a[c].name, b[c].name);
        EXPECT_NEAR(a[c].fx, b[c].fx, 1e-9);
        EXPECT_LT(angle_between(a[c].camera_from_world.rotation, b[c].camera_from_world.rotation), 1e-6);
        EXPECT_LT(norm(a[c].centre_in_world() - b[c].centre_in_world()), 1e-9);
    }
}

class CalibrationTest : public testing::DaemonTest {
  protected:
    static void SetUpTestSuite() {
        shared_ = new testing::TemporaryFolder;
        board_ = new BoardSession(write_board_session(shared_->path()));
        session_ = board_->session;
    }
    static void TearDownTestSuite() {
        delete board_;
        delete shared_;
        shared_ = nullptr;
    }

    // The capture itself is of no interest: coarse voxels, no poses.
    std::string config(const std::string& source = "",
                       const std::string& pose = "enabled = false\ndatabase_file = \"\"") {
        return session_config("127.0.0.1:0", source, pose) +
               "[calibration]\nfolder = \"calibrations\"\n[pipeline]\nvoxel_mm = 50\ncolouring = false\n";
    }

    static inline BoardSession* board_ = nullptr;
};

// Of the centres in the world that the board on the floor makes, m: as they stand, and after a rigid motion.
struct CentreErrors {
    double in_world = 0, among_them = 0;
};
CentreErrors centre_errors(const std::vector<Camera>& truth, const std::vector<Camera>& solved) {
    std::vector<Vec3> found, right;
    for (const Camera& camera : truth) {
        found.push_back(camera_named(solved, camera.name)->centre_in_world());
        right.push_back(on_floor().inverse() * camera.centre_in_world());
    }
    const SimilarityTransform aligned = *align_points(found, right, false);
    CentreErrors errors;
    for (std::size_t c = 0; c < truth.size(); ++c) {
        errors.in_world = std::max(errors.in_world, norm(found[c] - right[c]));
        errors.among_them = std::max(errors.among_them, norm(aligned(found[c]) - right[c]));
    }
    return errors;
}

TEST_F(CalibrationTest, SolvesAppliesAndUndoesExtrinsicsFromBoard) {
    auto daemon = start_daemon(config());
    Operator coach(address_);
    const std::vector<Camera> own = *coach.client().cameras();
    wait_until_running(coach.client());
    ASSERT_TRUE(coach.start(v1::PROCEDURE_KIND_EXTRINSICS_BOARD).ok());
    v1::WatchProcedureResponse seen = coach.wait([](const auto&) { return true; });
    EXPECT_EQ(seen.state(), v1::PROCEDURE_STATE_COLLECTING);
    EXPECT_EQ(seen.procedure_id(), 1u);
    EXPECT_THAT(seen.hints(), Contains(HasSubstr("camera " + own[0].name + " has not detected the board")));
    EXPECT_THAT(seen.hints(), Contains(HasSubstr("floor")));
    EXPECT_FALSE(seen.collecting_live());

    // Nothing seen: back to collecting, with what is missing.
    ASSERT_TRUE(coach.solve().ok());
    seen = coach.wait(collecting);
    EXPECT_THAT(seen.message(), HasSubstr("not solved: no two cameras detected the board at the same time"));

    // Another operator may not; one procedure at a time.
    EXPECT_REFUSED(coach.start(v1::PROCEDURE_KIND_INTRINSICS), kFailedPrecondition,
                   "another procedure is open");
    ASSERT_TRUE(coach.take(v1::LiveObservations::STEP_BOARD_ON_FLOOR).ok());
    seen = coach.wait(
        [](const auto& progress) { return progress.floor_defined() && !progress.collecting_live(); });
    EXPECT_GE(seen.shared_frame_set_count(), 1);
    ASSERT_TRUE(coach.take(v1::LiveObservations::STEP_MOVING_TARGET).ok());
    seen = coach.wait([](const auto& progress) { return progress.shared_frame_set_count() >= 20; });
    EXPECT_TRUE(seen.collecting_live());
    EXPECT_EQ(seen.live_step(), v1::LiveObservations::STEP_MOVING_TARGET);
    ASSERT_EQ(seen.cameras_size(), 4);
    for (const v1::CameraObservations& camera : seen.cameras()) {
        EXPECT_GT(camera.accepted_count(), 5);
        EXPECT_GT(camera.coverage(), 0.2);
        EXPECT_EQ(camera.coverage_counts_size(), 48);
        int rejected = 0;
        for (const auto& one : camera.rejections()) rejected += one.count();
        EXPECT_EQ(camera.image_count(), camera.accepted_count() + rejected);
    }
    ASSERT_TRUE(coach.solve().ok());
    seen = coach.wait(over);
    ASSERT_EQ(seen.state(), v1::PROCEDURE_STATE_SOLVED) << seen.DebugString();
    EXPECT_EQ(seen.calibration_id(), "c1");
    EXPECT_EQ(seen.progress(), 1);
    EXPECT_NE(seen.verdict(), v1::VERDICT_UNSPECIFIED);
    EXPECT_REFUSED(coach.solve(), kFailedPrecondition, "no procedure is open");

    // As good as the library's own: the truth is known.
    const auto solved = parse_calibration_toml(*coach.export_as("c1", v1::CALIBRATION_FORMAT_TOML), "c1");
    ASSERT_TRUE(solved.ok()) << solved.status();
    ASSERT_EQ(solved->size(), 4u);
    EXPECT_LT(centre_errors(board_->truth, *solved).among_them, 0.03);
    EXPECT_LT(centre_errors(board_->truth, *solved).in_world,
              0.15);  // five metres from a board seen at a low angle
    v1::GetCertificateRequest of_c1;
    of_c1.set_calibration_id("c1");
    const auto certificate = coach.client().get_certificate(of_c1);
    ASSERT_TRUE(certificate.ok()) << certificate.status();
    EXPECT_EQ(certificate->certificate().verdict(), seen.verdict());
    EXPECT_EQ(certificate->certificate().method(), v1::CALIBRATION_METHOD_EXTRINSICS_BOARD);
    EXPECT_TRUE(certificate->certificate().world_defined());
    EXPECT_LT(certificate->certificate().held_out_reprojection_rms_px(),
              2.0);  // the frame sets differ from run to run
    ASSERT_EQ(certificate->certificate().cameras_size(), 4);
    EXPECT_GT(certificate->certificate().cameras(0).view_count(), 5);
    EXPECT_EQ(json::parse(certificate->certificate_json())["method"], "extrinsics_board");
    EXPECT_TRUE(certificate->page_png().empty()) << "not asked for";
    of_c1.set_include_page(true);
    const auto with_page = coach.client().get_certificate(of_c1);
    ASSERT_TRUE(with_page.ok()) << with_page.status();
    EXPECT_TRUE(with_page->page_png().starts_with("\x89PNG")) << with_page->page_png().size() << " bytes";

    // Applied from the next start of the capture, unless it is restarted.
    const bool bad = seen.verdict() == v1::VERDICT_NO_GO;
    auto applied = coach.apply("c1", false, bad);
    ASSERT_TRUE(applied.ok()) << applied.status();
    EXPECT_FALSE(applied->active());
    EXPECT_EQ(coach.list().active_id(), "");
    EXPECT_EQ(coach.list().pending_id(), "c1");
    EXPECT_EQ(*coach.client().cameras(), own);
    applied = coach.apply("c1", true, bad);
    ASSERT_TRUE(applied.ok()) << applied.status();
    EXPECT_TRUE(applied->active());
    EXPECT_EQ(coach.list().active_id(), "c1");
    EXPECT_TRUE(coach.list().can_undo());
    expect_same(*coach.client().cameras(), *solved);
    EXPECT_EQ(coach.client().status()->state(), v1::CAPTURE_STATE_RUNNING);
    EXPECT_EQ(coach.client().status()->active_calibration_id(), "c1");
    const std::vector<std::string> events =
        coach.events(v1::EVENT_KIND_CALIBRATION_CHANGED, 3, std::chrono::seconds(10));
    EXPECT_THAT(events,
                ElementsAre(HasSubstr("c1 is solved"), HasSubstr("next start"), HasSubstr("c1 is active")));
    v1::DeleteCalibrationRequest remove;
    remove.set_lease_id(coach.lease());
    remove.set_calibration_id("c1");
    EXPECT_REFUSED(coach.client().delete_calibration(remove), kFailedPrecondition, "is active");

    // It survives the daemon, and the session is as it was.
    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(std::chrono::seconds(10)), 0);
    EXPECT_EQ(*read_calibration(session_.parent_path() / "calibration.toml"), own);
    daemon = start_daemon(config());
    Operator again(address_);
    expect_same(*again.client().cameras(), *solved);
    EXPECT_EQ(again.list().active_id(), "c1");
    const auto undone = again.undo(true);
    ASSERT_TRUE(undone.ok()) << undone.status();
    EXPECT_EQ(undone->calibration_id(), "");
    EXPECT_TRUE(undone->active());
    EXPECT_EQ(*again.client().cameras(), own);
    EXPECT_REFUSED(again.undo(false), kFailedPrecondition, "nothing to undo");
    remove.set_lease_id(again.lease());
    EXPECT_TRUE(again.client().delete_calibration(remove).ok());
    EXPECT_EQ(again.list().calibrations_size(), 0);
}

TEST_F(CalibrationTest, ReadsFilesAndSolvesIntrinsics) {
    const auto daemon = start_daemon(config("autostart = false\n"));
    Operator coach(address_);
    EXPECT_REFUSED(coach.take(v1::LiveObservations::STEP_MOVING_TARGET), kFailedPrecondition, "not running");
    ASSERT_TRUE(coach.start(v1::PROCEDURE_KIND_INTRINSICS).ok());
    // Reading is stopped; the procedure continues.
    v1::AddObservationsRequest many = coach.clips(board_->truth, session_.parent_path());
    ASSERT_TRUE(coach.client().add_observations(many).ok());
    EXPECT_REFUSED(coach.client().add_observations(many), kFailedPrecondition, "reads files");
    EXPECT_REFUSED(coach.solve(), kFailedPrecondition, "reads files");
    ASSERT_TRUE(coach.cancel(true).ok());
    v1::WatchProcedureResponse seen = coach.wait(collecting);
    EXPECT_THAT(seen.message(), HasSubstr("stopped"));
    EXPECT_EQ(seen.cameras(0).image_count(), 0);
    EXPECT_REFUSED(coach.cancel(true), kFailedPrecondition, "nothing to stop");
    // Read to their end.
    ASSERT_TRUE(coach.client().add_observations(many).ok());
    double part = 0;
    seen = coach.wait([&](const auto& progress) {
        part = std::max(part, progress.progress());
        return collecting(progress);
    });
    EXPECT_GT(part, 0);
    EXPECT_THAT(seen.message(), HasSubstr("read"));
    for (const v1::CameraObservations& camera : seen.cameras()) {
        EXPECT_EQ(camera.image_count(), kMoments);
        EXPECT_GT(camera.accepted_count(), 3);
        std::vector<std::string> reasons;
        for (const auto& one : camera.rejections()) reasons.push_back(one.reason());
        EXPECT_THAT(reasons, Contains("duplicate"));  // on the floor it lay still
    }
    ASSERT_TRUE(coach.solve().ok());
    seen = coach.wait([](const auto& progress) { return over(progress) || collecting(progress); });
    ASSERT_EQ(seen.state(), v1::PROCEDURE_STATE_SOLVED) << seen.DebugString();
    const auto intrinsics =
        parse_calibration_toml(*coach.export_as(seen.calibration_id(), v1::CALIBRATION_FORMAT_TOML), "");
    ASSERT_TRUE(intrinsics.ok());
    const std::vector<Camera> own = *coach.client().cameras();
    for (std::size_t c = 0; c < own.size(); ++c) {
        EXPECT_NEAR((*intrinsics)[c].fx / board_->truth[c].fx, 1, 0.12);  // small images, few views
        EXPECT_LT(norm((*intrinsics)[c].centre_in_world() - own[c].centre_in_world()), 1e-9);
    }
    // Extrinsics with these intrinsics.
    v1::StartProcedureRequest extrinsics = coach.procedure(v1::PROCEDURE_KIND_EXTRINSICS_BOARD);
    extrinsics.set_intrinsics_calibration_id("c99");
    EXPECT_REFUSED(coach.client().start_procedure(extrinsics), kNotFound, "c99");
    extrinsics.set_intrinsics_calibration_id(seen.calibration_id());
    EXPECT_TRUE(coach.client().start_procedure(extrinsics).ok());
    EXPECT_TRUE(coach.cancel().ok());
    EXPECT_EQ(coach.wait(over).state(), v1::PROCEDURE_STATE_CANCELLED);
}

TEST_F(CalibrationTest, RejectsInvalidRequestsWithReason) {
    const auto daemon = start_daemon(config("autostart = false\n"));
    Operator coach(address_);
    client::Client& client = coach.client();
    // Without control, and with a wrong lease.
    v1::StartProcedureRequest request = coach.procedure(v1::PROCEDURE_KIND_INTRINSICS);
    request.set_lease_id("");
    EXPECT_REFUSED(client.start_procedure(request), kFailedPrecondition, "coach");
    request.set_lease_id(coach.lease());
    request.set_kind(v1::PROCEDURE_KIND_UNSPECIFIED);
    EXPECT_REFUSED(client.start_procedure(request), kInvalidArgument, "INTRINSICS");
    request.set_kind(v1::PROCEDURE_KIND_INTRINSICS);
    request.set_board("chess");
    EXPECT_REFUSED(client.start_procedure(request), kInvalidArgument, "chess");
    request.set_board(kBoard);
    request.add_cameras("unknown");
    EXPECT_REFUSED(client.start_procedure(request), kNotFound, "unknown");
    request.clear_cameras();
    request.set_note("a\nb");
    EXPECT_REFUSED(client.start_procedure(request), kInvalidArgument, "note");
    request.clear_note();
    request.mutable_idle_timeout()->set_nanos(-1 * 1000000);
    EXPECT_REFUSED(client.start_procedure(request), kInvalidArgument, "idle_timeout");
    request.clear_idle_timeout();
    request.set_kind(v1::PROCEDURE_KIND_EXTRINSICS_BOARD);
    request.set_board("checkerboard:4x6:60");
    EXPECT_REFUSED(client.start_procedure(request), kInvalidArgument, "half a turn");
    request.set_board(kBoard);
    request.add_cameras(board_->truth[0].name);
    EXPECT_REFUSED(client.start_procedure(request), kFailedPrecondition, "at least two");
    request.clear_cameras();
    request.set_kind(v1::PROCEDURE_KIND_EXTRINSICS_WAND);
    request.set_wand("wand:600:200");
    EXPECT_REFUSED(client.start_procedure(request), kInvalidArgument, "wand");
    request.set_kind(v1::PROCEDURE_KIND_EXTRINSICS_REFINE_PERSON);
    request.set_stature_m(4);
    EXPECT_REFUSED(client.start_procedure(request), kInvalidArgument, "stature");

    // No procedure.
    EXPECT_REFUSED(coach.solve(), kFailedPrecondition, "no procedure is open");
    EXPECT_REFUSED(coach.cancel(), kFailedPrecondition, "no procedure is open");
    EXPECT_EQ(coach.wait([](const auto&) { return true; }).state(), v1::PROCEDURE_STATE_NONE);

    // Observations of a kind, and files, that the procedure does not take.
    ASSERT_TRUE(client.start("other").code() == absl::StatusCode::kFailedPrecondition);
    ASSERT_TRUE(client.start(client::Lease{coach.lease()}).ok());
    ASSERT_TRUE(coach.start(v1::PROCEDURE_KIND_INTRINSICS).ok());
    EXPECT_REFUSED(coach.take(v1::LiveObservations::STEP_BOARD_ON_FLOOR), kInvalidArgument, "floor");
    EXPECT_REFUSED(coach.take(v1::LiveObservations::STEP_EMPTY_SCENE), kInvalidArgument, "wand");
    v1::AddObservationsRequest nothing;
    nothing.set_lease_id(coach.lease());
    EXPECT_REFUSED(client.add_observations(nothing), kInvalidArgument, "set live or files");
    v1::AddObservationsRequest files = coach.clips(board_->truth, session_.parent_path());
    files.mutable_files()->mutable_clips(0)->set_path("relative.mp4");
    EXPECT_REFUSED(client.add_observations(files), kInvalidArgument, "absolute");
    files.mutable_files()->mutable_clips(0)->set_path("/nowhere.mp4");
    EXPECT_REFUSED(client.add_observations(files), kNotFound, "/nowhere.mp4");
    files.mutable_files()->mutable_clips(0)->set_camera("unknown");
    EXPECT_REFUSED(client.add_observations(files), kNotFound, "unknown");
    files = coach.clips(board_->truth, session_.parent_path());
    files.mutable_files()->set_stride(-1);
    EXPECT_REFUSED(client.add_observations(files), kInvalidArgument, "stride");
    files.mutable_files()->set_stride(1);
    files.mutable_files()->set_session_path(session_.string());
    EXPECT_REFUSED(client.add_observations(files), kInvalidArgument, "session");
    ASSERT_TRUE(coach.cancel().ok());
    request = coach.procedure(v1::PROCEDURE_KIND_EXTRINSICS_WAND);
    request.set_wand("wand:200:600");
    ASSERT_TRUE(client.start_procedure(request).ok());
    EXPECT_REFUSED(coach.take(v1::LiveObservations::STEP_MOVING_TARGET), kFailedPrecondition,
                   "empty scene first");
    ASSERT_TRUE(coach.take(v1::LiveObservations::STEP_EMPTY_SCENE).ok());
    coach.wait([](const auto& progress) { return !progress.collecting_live(); });
    EXPECT_TRUE(coach.take(v1::LiveObservations::STEP_MOVING_TARGET).ok());
    ASSERT_TRUE(coach.cancel().ok());

    // Calibrations that are not there, not whole, not good, or of others.
    v1::GetCertificateRequest certificate;
    for (const char* id : {"c1", "", "../c1", "c01", "c-1", "c99999999999"}) {
        certificate.set_calibration_id(id);
        EXPECT_REFUSED(client.get_certificate(certificate), kNotFound, "does not exist");
        EXPECT_REFUSED(coach.apply(id, false), kNotFound, "does not exist");
    }
    EXPECT_REFUSED(coach.import("no toml [", v1::CALIBRATION_FORMAT_TOML), kInvalidArgument,
                   "the calibration");
    EXPECT_REFUSED(coach.import(std::string((1 << 20) + 1, '#'), v1::CALIBRATION_FORMAT_TOML),
                   kInvalidArgument, "bytes");
    EXPECT_REFUSED(coach.import("", static_cast<v1::CalibrationFormat>(77)), kInvalidArgument, "77");
    std::vector<Camera> cameras = *client.cameras();
    const auto kalibr = coach.import(calibration_kalibr_yaml(cameras), v1::CALIBRATION_FORMAT_KALIBR);
    ASSERT_TRUE(kalibr.ok()) << kalibr.status();
    EXPECT_REFUSED(coach.apply(*kalibr, false), kFailedPrecondition, "has no world");
    EXPECT_REFUSED(coach.apply(*kalibr, false, true), kFailedPrecondition,
                   "has no camera");  // Kalibr's are cam0, cam1, ...
    cameras[0].width += 2;
    const auto other_size = coach.import(calibration_toml(cameras), v1::CALIBRATION_FORMAT_TOML);
    ASSERT_TRUE(other_size.ok());
    EXPECT_REFUSED(coach.apply(*other_size, false), kFailedPrecondition, "px");
    EXPECT_FALSE(coach.list().calibrations(1).compatible());
    EXPECT_REFUSED(coach.undo(false), kFailedPrecondition, "nothing to undo");
    EXPECT_REFUSED(coach.export_as("", v1::CALIBRATION_FORMAT_QUALISYS), kInvalidArgument,
                   "cannot be exported");
    cameras = *client.cameras();
    cameras[0].k3 = 0.01;
    const auto with_k3 = coach.import(calibration_toml(cameras), v1::CALIBRATION_FORMAT_TOML);
    EXPECT_REFUSED(coach.export_as(*with_k3, v1::CALIBRATION_FORMAT_KALIBR), kInvalidArgument, "k3");
    // Through every format there and back.
    for (const auto format : {v1::CALIBRATION_FORMAT_TOML, v1::CALIBRATION_FORMAT_OPENCV}) {
        const auto text = coach.export_as("", format);
        ASSERT_TRUE(text.ok()) << text.status();
        const auto id = coach.import(*text, format);
        ASSERT_TRUE(id.ok()) << id.status();
        EXPECT_TRUE(coach.list().calibrations(coach.list().calibrations_size() - 1).compatible());
        const auto there_and_back =
            parse_calibration_toml(*coach.export_as(*id, v1::CALIBRATION_FORMAT_TOML), *id);
        ASSERT_TRUE(there_and_back.ok()) << there_and_back.status();
        expect_same(*there_and_back, *client.cameras());
    }
}

TEST_F(CalibrationTest, EndsIdleProcedure) {
    const auto daemon = start_daemon(config());
    Operator coach(address_);
    wait_until_running(coach.client());
    v1::StartProcedureRequest request = coach.procedure(v1::PROCEDURE_KIND_INTRINSICS);
    request.mutable_idle_timeout()->set_nanos(300 * 1000000);
    ASSERT_TRUE(client::Client({.server = address_}).start_procedure(request).ok());
    ASSERT_TRUE(coach.take(v1::LiveObservations::STEP_MOVING_TARGET).ok());
    // Watched it lives on; its owner gone, it lets others in.
    const auto begun = std::chrono::steady_clock::now();
    coach.wait([&](const auto& progress) {
        EXPECT_EQ(progress.state(), v1::PROCEDURE_STATE_COLLECTING);
        return std::chrono::steady_clock::now() - begun > std::chrono::seconds(1);
    });
    absl::Status started = absl::FailedPreconditionError("");
    const auto left = std::chrono::steady_clock::now();
    while (!started.ok() && std::chrono::steady_clock::now() - left < std::chrono::seconds(10)) {
        started = coach.start(v1::PROCEDURE_KIND_INTRINSICS);
        std::this_thread::yield();
    }
    EXPECT_TRUE(started.ok()) << started;
    EXPECT_EQ(coach.wait([](const auto&) { return true; }).procedure_id(), 2u);
    daemon->signal(SIGTERM);  // an open procedure does not hold the daemon up
    EXPECT_EQ(daemon->wait(std::chrono::seconds(10)), 0);
}

TEST_F(CalibrationTest, RebuildsPoseDatabaseWhenApplied) {
    const auto daemon = start_daemon(
        config("autostart = false\n",
               "auto_fit_body = false\ndatabase_file = \"poses.kvxposes\"\nlibrary_pose_count = 2"));
    Operator coach(address_);
    const auto wait_ready = [&] {
        std::vector<v1::PoseDatabaseState> states;
        EXPECT_TRUE(coach.client()
                        .watch_pose_database(
                            [&](const v1::WatchPoseDatabaseResponse& progress) {
                                states.push_back(progress.state());
                                return progress.state() != v1::POSE_DATABASE_STATE_READY;
                            },
                            {.idle_timeout = std::chrono::seconds(20)})
                        .ok());
        return states;
    };
    wait_ready();
    std::vector<Camera> cameras = *coach.client().cameras();
    for (Camera& camera : cameras) camera.camera_from_world.translation.z += 1.5;  // seen from farther away
    const auto id = coach.import(calibration_toml(cameras), v1::CALIBRATION_FORMAT_TOML);
    ASSERT_TRUE(id.ok()) << id.status();
    // Stopped: active at once.
    const auto applied = coach.apply(*id, false);
    ASSERT_TRUE(applied.ok()) << applied.status();
    EXPECT_TRUE(applied->active());
    expect_same(*coach.client().cameras(), cameras);
    wait_ready();
    const std::vector<std::string> events =
        coach.events(v1::EVENT_KIND_POSE_DATABASE_READY, 2, std::chrono::seconds(20));
    ASSERT_EQ(events.size(), 2u);
    EXPECT_THAT(events[1], HasSubstr("cameras"));  // why it was built
}

// The command line: files on the daemon's machine, then what is stored.
TEST_F(CalibrationTest, IsGuidedFromTheCommandLine) {
    const auto daemon = start_daemon(config("autostart = false\n"));
    std::vector<std::string> start{
        "calibrate", "start",    "extrinsics", "--board", kBoard, "--board-on-floor-frame",
        "0",         "--stride", "2",          "--note",  "hall"};  // consecutive images show no movement
    for (const Camera& camera : board_->truth)
        start.push_back(camera.name + "=" + (session_.parent_path() / camera.name).string());
    const auto solved = kinevox(start);
    ASSERT_EQ(solved.status, 0) << solved.errors << solved.output;
    EXPECT_THAT(solved.output, AllOf(HasSubstr("reading"), HasSubstr("solving"), HasSubstr("solved: c1"),
                                     HasSubstr("held-out reprojection error"), HasSubstr("stored as c1")));
    EXPECT_EQ(kinevox({"calibrate", "apply", "c1", "--force"}).output, "c1 is active\n");
    EXPECT_THAT(kinevox({"calibrate", "list"}).output,
                AllOf(HasSubstr("c1 "), HasSubstr("extrinsics from a board"), HasSubstr("active"),
                      HasSubstr("hall")));
    const auto certificate = kinevox({"calibrate", "show", "c1"});
    EXPECT_THAT(certificate.output, AllOf(HasSubstr("camera"), HasSubstr(board_->truth[0].name)));
    EXPECT_EQ(json::parse(kinevox({"calibrate", "show", "c1", "--json"}).output)["method"],
              "extrinsics_board");

    // Import and export work with the daemon, convert with files.
    const std::string own = (session_.parent_path() / "calibration.toml").string();
    EXPECT_THAT(kinevox({"calibrate", "import", own}).output, HasSubstr("c2: 4 cameras"));
    const std::string out = (folder_.path() / "out.yml").string();
    EXPECT_EQ(kinevox({"calibrate", "export", "c2", "--format", "opencv", "--out", out}).status, 0);
    expect_same(*read_calibration(out), *read_calibration(own));
    EXPECT_THAT(kinevox({"calibrate", "import", out}).output, HasSubstr("c3: 4 cameras"));
    EXPECT_THAT(kinevox({"calibrate", "export"}).output, HasSubstr("[" + board_->truth[0].name + "]"));
    const std::string offline = (folder_.path() / "offline.toml").string();
    EXPECT_THAT(kinevox({"calibrate", "convert", out, "--out", offline}).output, HasSubstr("written to"));
    expect_same(*read_calibration(offline), *read_calibration(own));

    const auto as_json = json::parse(kinevox({"calibrate", "list", "--json"}).output);
    EXPECT_EQ(as_json["active_id"], "c1");
    EXPECT_EQ(as_json["calibrations"].size(), 3u);
    EXPECT_THAT(kinevox({"calibrate", "undo"}).output, HasSubstr("the source's own calibration is active"));
    EXPECT_EQ(kinevox({"calibrate", "delete", "c1", "--yes"}).output, "deleted c1\n");
    for (const auto& [arguments, words] : std::vector<std::pair<std::vector<std::string>, std::string>>{
             {{"calibrate", "apply", "c1"}, "calibration 'c1' does not exist"},
             {{"calibrate", "undo"}, "nothing to undo"},
             {{"calibrate", "cancel"}, "no procedure is open"},
             {{"calibrate", "start", "extrinsics"}, "board"},
             {{"calibrate", "start", "intrinsics", "--board", kBoard}, "the capture is not running"},
             {{"calibrate", "start", "intrinsics", "--board", kBoard, "cam1=/nowhere"}, "/nowhere"},
             {{"calibrate", "start", "floors"}, "floors"},
             {{"calibrate", "nonsense"}, "unknown calibrate command 'nonsense'"}}) {
        const auto refused = kinevox(arguments);
        EXPECT_EQ(refused.status, 1);
        EXPECT_THAT(refused.errors, HasSubstr(words));
        EXPECT_EQ(std::count(refused.errors.begin(), refused.errors.end(), '\n'), 1) << refused.errors;
    }
    EXPECT_THAT(kinevox({"calibrate", "watch"}).output,
                HasSubstr("cancelled"));  // no procedure was left behind
}

// Whether the process has blocked SIGINT, as it does once it waits for it.
bool waits_for_interrupts(pid_t process) {
    std::ifstream status(fmt::format("/proc/{}/status", process));
    for (std::string line; std::getline(status, line);)
        if (line.starts_with("SigBlk:"))
            return (std::stoull(line.substr(7), nullptr, 16) >> (SIGINT - 1) & 1) != 0;
    return false;
}

TEST_F(CalibrationTest, StopsFileCommandsOnSigint) {
    // The same images over and over: longer than anybody waits.
    const std::filesystem::path many = folder_.path() / "many";
    std::filesystem::create_directory(many);
    for (int i = 0; i < 20'000; ++i)
        std::filesystem::create_symlink(
            session_.parent_path() / board_->truth[0].name / fmt::format("{:04}.ppm", i % kMoments),
            many / fmt::format("{:05}.ppm", i));
    const std::string out = (folder_.path() / "intrinsics.toml").string();
    testing::ChildProcess verb(
        {KINEVOX_CALIBRATE, "intrinsics", "cam1=" + many.string(), "--board", kBoard, "--out", out},
        folder_.path());
    while (!waits_for_interrupts(verb.id()) && !verb.wait(std::chrono::milliseconds(1))) {
    }
    verb.signal(SIGINT);
    EXPECT_EQ(verb.wait(std::chrono::seconds(20)), 1);
    EXPECT_EQ(verb.errors(), "kinevox calibrate: stopped; nothing was written\n");
    EXPECT_FALSE(std::filesystem::exists(out));
}

}  // namespace
}  // namespace kinevox
