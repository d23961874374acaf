#include <fmt/format.h>

#include <algorithm>

#include "common/calibration_file.h"
#include "common/proto_time.h"
#include "common/utc_clock.h"
#include "server/api/calibration_service.h"
#include "server/api/replay_service.h"
#include "server/api/request_arguments.h"
#include "server/api/to_proto.h"

namespace kinevox {
namespace {

constexpr std::size_t kMaxNoteBytes = 200;
constexpr std::size_t kMaxTextBytes = 1 << 20;

void publish_change(const ApiContext& api, std::string message) {
    api.hub.events().publish(EventKind::kCalibrationChanged, std::move(message));
}

// Requests that change what the live cameras use.
absl::Status check_live_control(const ApiContext& api, const std::string& lease_id) {
    if (absl::Status control = use_control(api, lease_id); !control.ok()) return control;
    return check_live(api, "calibration requires");
}

absl::Status check_note(const std::string& note) {
    if (note.size() > kMaxNoteBytes)
        return absl::InvalidArgumentError(
            fmt::format("note has {} bytes; at most {} are allowed", note.size(), kMaxNoteBytes));
    if (std::ranges::any_of(note, [](unsigned char c) { return c < 0x20 || c == 0x7f; }))
        return absl::InvalidArgumentError(
            "note contains a control character; use one line of printable characters");
    return absl::OkStatus();
}

absl::StatusOr<ProcedureKind> kind_of(v1::ProcedureKind kind) {
    switch (kind) {
        case v1::PROCEDURE_KIND_INTRINSICS:
            return ProcedureKind::kIntrinsics;
        case v1::PROCEDURE_KIND_EXTRINSICS_BOARD:
            return ProcedureKind::kExtrinsicsBoard;
        case v1::PROCEDURE_KIND_EXTRINSICS_WAND:
            return ProcedureKind::kExtrinsicsWand;
        case v1::PROCEDURE_KIND_EXTRINSICS_REFINE_PERSON:
            return ProcedureKind::kExtrinsicsRefinePerson;
        default:
            return absl::InvalidArgumentError(
                fmt::format("kind {} is unknown; use INTRINSICS, EXTRINSICS_BOARD, EXTRINSICS_WAND or "
                            "EXTRINSICS_REFINE_PERSON",
                            static_cast<int>(kind)));
    }
}

v1::ProcedureKind to_proto(ProcedureKind kind) {
    switch (kind) {
        case ProcedureKind::kIntrinsics:
            return v1::PROCEDURE_KIND_INTRINSICS;
        case ProcedureKind::kExtrinsicsBoard:
            return v1::PROCEDURE_KIND_EXTRINSICS_BOARD;
        case ProcedureKind::kExtrinsicsWand:
            return v1::PROCEDURE_KIND_EXTRINSICS_WAND;
        case ProcedureKind::kExtrinsicsRefinePerson:
            return v1::PROCEDURE_KIND_EXTRINSICS_REFINE_PERSON;
    }
    return v1::PROCEDURE_KIND_UNSPECIFIED;
}

absl::StatusOr<LiveStep> live_step_of(v1::LiveObservations::Step step) {
    switch (step) {
        case v1::LiveObservations::STEP_UNSPECIFIED:
        case v1::LiveObservations::STEP_MOVING_TARGET:
            return LiveStep::kMovingTarget;
        case v1::LiveObservations::STEP_BOARD_ON_FLOOR:
            return LiveStep::kBoardOnFloor;
        case v1::LiveObservations::STEP_EMPTY_SCENE:
            return LiveStep::kEmptyScene;
        case v1::LiveObservations::STEP_PAUSE:
            return LiveStep::kPause;
        default:
            return absl::InvalidArgumentError(
                fmt::format("step {} is unknown; use MOVING_TARGET, BOARD_ON_FLOOR, EMPTY_SCENE or PAUSE",
                            static_cast<int>(step)));
    }
}

v1::LiveObservations::Step to_proto(LiveStep step) {
    switch (step) {
        case LiveStep::kPause:
            return v1::LiveObservations::STEP_PAUSE;
        case LiveStep::kMovingTarget:
            return v1::LiveObservations::STEP_MOVING_TARGET;
        case LiveStep::kBoardOnFloor:
            return v1::LiveObservations::STEP_BOARD_ON_FLOOR;
        case LiveStep::kEmptyScene:
            return v1::LiveObservations::STEP_EMPTY_SCENE;
    }
    return v1::LiveObservations::STEP_UNSPECIFIED;
}

v1::ProcedureState to_proto(ProcedureState state) {
    switch (state) {
        case ProcedureState::kNone:
            return v1::PROCEDURE_STATE_NONE;
        case ProcedureState::kCollecting:
            return v1::PROCEDURE_STATE_COLLECTING;
        case ProcedureState::kReading:
            return v1::PROCEDURE_STATE_READING_FILES;
        case ProcedureState::kSolving:
            return v1::PROCEDURE_STATE_SOLVING;
        case ProcedureState::kSolved:
            return v1::PROCEDURE_STATE_SOLVED;
        case ProcedureState::kCancelled:
            return v1::PROCEDURE_STATE_CANCELLED;
        case ProcedureState::kFailed:
            return v1::PROCEDURE_STATE_FAILED;
    }
    return v1::PROCEDURE_STATE_UNSPECIFIED;
}

v1::Verdict to_proto(std::optional<Verdict> verdict) {
    if (!verdict) return v1::VERDICT_UNSPECIFIED;
    switch (*verdict) {
        case Verdict::kGo:
            return v1::VERDICT_GO;
        case Verdict::kCaution:
            return v1::VERDICT_CAUTION;
        case Verdict::kNoGo:
            return v1::VERDICT_NO_GO;
    }
    return v1::VERDICT_UNSPECIFIED;
}

// The active cameras, with the intrinsics of the named calibration.
absl::StatusOr<std::vector<Camera>> cameras_with_intrinsics(const ApiContext& api,
                                                            const std::string& calibration_id) {
    std::vector<Camera> cameras = api.runner.cameras();
    if (calibration_id.empty()) return cameras;
    const auto stored = api.calibration.store->compatible_cameras(calibration_id);
    if (!stored.ok()) return stored.status();
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        const Rigid3 camera_from_world = cameras[c].camera_from_world;
        cameras[c] = (*stored)[c];
        cameras[c].camera_from_world = camera_from_world;
    }
    return cameras;
}

absl::StatusOr<std::vector<Camera>> parse_calibration(const std::string& text, v1::CalibrationFormat format) {
    const std::string name = "the calibration";
    switch (format) {
        case v1::CALIBRATION_FORMAT_UNSPECIFIED:
        case v1::CALIBRATION_FORMAT_TOML:
            return parse_calibration_toml(text, name);
        case v1::CALIBRATION_FORMAT_OPENCV:
            return parse_calibration_opencv(text, name);
        case v1::CALIBRATION_FORMAT_KALIBR:
            return parse_calibration_kalibr(text, name);
        case v1::CALIBRATION_FORMAT_QUALISYS:
            return parse_calibration_qualisys(text, name);
        default:
            return absl::InvalidArgumentError(fmt::format(
                "format {} is unknown; use TOML, OPENCV, KALIBR or QUALISYS", static_cast<int>(format)));
    }
}

// FailedPrecondition if the calibration must not be applied without force.
absl::Status check_verdict(const ApiContext& api, const std::string& calibration_id) {
    const auto json = api.calibration.store->certificate_json(calibration_id);
    if (!json.ok()) return json.status();
    const v1::Certificate certificate = certificate_to_proto(*json);
    if (certificate.verdict() == v1::VERDICT_NO_GO) {
        const auto worst = std::ranges::find_if(
            certificate.findings(),
            [](const v1::CertificateFinding& finding) { return finding.verdict() == v1::VERDICT_NO_GO; });
        return absl::FailedPreconditionError(
            fmt::format("calibration {} is NO-GO{}; calibrate again, or apply it with force", calibration_id,
                        worst == certificate.findings().end() ? "" : ": " + worst->reason()));
    }
    if (!certificate.world_defined())
        return absl::FailedPreconditionError(fmt::format(
            "calibration {} has no world frame: the floor is unknown; calibrate with the board on the "
            "floor, or apply it with force",
            calibration_id));
    return absl::OkStatus();
}

std::string applied_message(const ActiveCalibration::Applied& applied) {
    return (applied.id.empty() ? "the source's own calibration" : "calibration " + applied.id) +
           (applied.active ? " is active" : " becomes active at the next start of the capture");
}

v1::CameraObservations to_proto(const CameraObservations& camera) {
    v1::CameraObservations out;
    out.set_name(camera.name);
    out.set_image_count(camera.image_count);
    out.set_accepted_count(camera.accepted_count);
    for (const auto& [reason, count] : camera.rejections) {
        v1::ViewRejection& rejection = *out.add_rejections();
        rejection.set_reason(reason);
        rejection.set_count(count);
    }
    out.set_coverage(camera.coverage);
    *out.mutable_coverage_counts() = {camera.coverage_counts.begin(), camera.coverage_counts.end()};
    out.set_detected_in_latest(camera.detected_in_latest);
    out.set_latest_rejection_reason(camera.latest_rejection_reason);
    return out;
}

v1::Calibration to_proto(const CalibrationListing& listing, const std::string& active_id) {
    v1::Calibration out;
    out.set_id(listing.id);
    *out.mutable_create_time() = to_timestamp(listing.time_utc_ns);
    out.set_method(calibration_method_to_proto(listing.method));
    out.set_verdict(to_proto(listing.verdict));
    out.set_note(listing.note);
    *out.mutable_cameras() = {listing.cameras.begin(), listing.cameras.end()};
    out.set_active(listing.id == active_id);
    out.set_compatible(listing.compatible);
    return out;
}

}  // namespace

absl::Status check_calibration(const ApiContext& api) {
    if (api.calibration.store && api.calibration.active && api.calibration.procedure &&
        api.calibration.procedure_watch)
        return absl::OkStatus();
    return absl::FailedPreconditionError("this daemon does not support calibration");
}

absl::Status start_procedure(const ApiContext& api, const v1::StartProcedureRequest& request,
                             v1::StartProcedureResponse& response) {
    if (absl::Status live = check_live_control(api, request.lease_id()); !live.ok()) return live;
    const auto kind = kind_of(request.kind());
    if (!kind.ok()) return kind.status();
    if (absl::Status note = check_note(request.note()); !note.ok()) return note;
    if (const auto stored = api.calibration.store->list(); !stored.ok())
        return stored.status();  // the result could not be stored
    ProcedureRequest procedure;
    procedure.kind = *kind;
    procedure.cameras = {request.cameras().begin(), request.cameras().end()};
    procedure.board = request.board();
    procedure.wand = request.wand();
    procedure.refine_intrinsics = request.refine_intrinsics();
    procedure.estimate_k3 = request.estimate_k3();
    procedure.stature_m = request.stature_m();
    procedure.note = request.note();
    const auto cameras = cameras_with_intrinsics(api, request.intrinsics_calibration_id());
    if (!cameras.ok()) return cameras.status();
    const auto procedure_id =
        api.calibration.procedure->start(procedure, *cameras, to_milliseconds(request.idle_timeout()));
    if (!procedure_id.ok()) return procedure_id.status();
    response.set_procedure_id(*procedure_id);
    return absl::OkStatus();
}

absl::Status add_observations(const ApiContext& api, const v1::AddObservationsRequest& request,
                              v1::AddObservationsResponse&) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    if (request.has_live()) {
        const auto step = live_step_of(request.live().step());
        if (!step.ok()) return step.status();
        const RunState state = api.runner.state().state;
        if (*step != LiveStep::kPause && state != RunState::kRunning && state != RunState::kLearning)
            return absl::FailedPreconditionError(
                "the capture is not running; start it to collect observations from its cameras");
        return api.calibration.procedure->collect_live(*step);
    }
    if (!request.has_files())
        return absl::InvalidArgumentError("the request has no observations; set live or files");
    ProcedureFiles files;
    for (const v1::CameraClip& clip : request.files().clips())
        files.clips.push_back({clip.camera(), clip.path(), {}});
    files.stride = request.files().stride() == 0 ? 1 : request.files().stride();
    if (request.files().has_board_on_floor_frame())
        files.board_on_floor_frame = request.files().board_on_floor_frame();
    files.session_path = request.files().session_path();
    return api.calibration.procedure->read(std::move(files));
}

absl::Status solve_procedure(const ApiContext& api, const v1::SolveProcedureRequest& request,
                             v1::SolveProcedureResponse&) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    return api.calibration.procedure->solve();
}

absl::Status cancel_procedure(const ApiContext& api, const v1::CancelProcedureRequest& request,
                              v1::CancelProcedureResponse&) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    return api.calibration.procedure->cancel(request.keep_observations());
}

v1::WatchProcedureResponse to_proto(const ProcedureProgress& progress) {
    v1::WatchProcedureResponse out;
    out.set_state(to_proto(progress.state));
    out.set_procedure_id(progress.number);
    out.set_progress(progress.progress);
    out.set_message(progress.message);
    out.set_verdict(to_proto(progress.verdict));
    out.set_calibration_id(progress.calibration_id);
    if (progress.number == 0) return out;
    out.set_kind(to_proto(progress.kind));
    out.set_collecting_live(progress.live_step != LiveStep::kPause);
    out.set_live_step(to_proto(progress.live_step));
    out.set_skipped_frame_set_count(progress.skipped_frame_set_count);
    const ProcedureReport& report = progress.report;
    *out.mutable_hints() = {report.hints.begin(), report.hints.end()};
    out.set_sufficient(report.sufficient);
    out.set_shared_frame_set_count(report.shared_frame_set_count);
    out.set_floor_defined(report.floor_defined);
    for (const CameraObservations& camera : report.cameras) *out.add_cameras() = to_proto(camera);
    return out;
}

absl::Status list_calibrations(const ApiContext& api, const v1::ListCalibrationsRequest& request,
                               v1::ListCalibrationsResponse& response) {
    const auto list = api.calibration.store->list();
    if (!list.ok()) return list.status();
    const auto page = page_of(list->size(), request);
    if (!page.ok()) return page.status();
    const std::string active_id = api.calibration.active->active();
    for (std::size_t i = page->first; i < page->last; ++i)
        *response.add_calibrations() = to_proto((*list)[i], active_id);
    response.set_next_page_token(page->next_token);
    response.set_active_id(active_id);
    response.set_pending_id(api.calibration.active->pending());
    const std::vector<std::string> applied = api.calibration.store->applied();
    response.set_can_undo(!applied.empty());
    if (applied.size() > 1) response.set_undo_id(applied[applied.size() - 2]);
    return absl::OkStatus();
}

absl::Status get_certificate(const ApiContext& api, const v1::GetCertificateRequest& request,
                             v1::GetCertificateResponse& response) {
    const auto json = api.calibration.store->certificate_json(request.calibration_id());
    if (!json.ok()) return json.status();
    *response.mutable_certificate() = certificate_to_proto(*json);
    response.set_certificate_json(*json);
    if (!request.include_page()) return absl::OkStatus();
    auto page = api.calibration.store->certificate_page(request.calibration_id());
    if (!page.ok()) return page.status();
    response.set_page_png(*std::move(page));
    return absl::OkStatus();
}

absl::Status apply_calibration(const ApiContext& api, const v1::ApplyCalibrationRequest& request,
                               v1::ApplyCalibrationResponse& response) {
    if (absl::Status live = check_live_control(api, request.lease_id()); !live.ok()) return live;
    if (absl::Status verdict = check_verdict(api, request.calibration_id());
        !verdict.ok() && !(request.force() && absl::IsFailedPrecondition(verdict)))
        return verdict;
    const auto applied = api.calibration.active->apply(request.calibration_id(), request.restart_capture());
    if (!applied.ok()) return applied.status();
    response.set_active(applied->active);
    publish_change(api, applied_message(*applied));
    return absl::OkStatus();
}

absl::Status undo_calibration(const ApiContext& api, const v1::UndoCalibrationRequest& request,
                              v1::UndoCalibrationResponse& response) {
    if (absl::Status live = check_live_control(api, request.lease_id()); !live.ok()) return live;
    const auto applied = api.calibration.active->undo(request.restart_capture());
    if (!applied.ok()) return applied.status();
    response.set_calibration_id(applied->id);
    response.set_active(applied->active);
    publish_change(api, "undone: " + applied_message(*applied));
    return absl::OkStatus();
}

absl::Status import_calibration(const ApiContext& api, const v1::ImportCalibrationRequest& request,
                                v1::ImportCalibrationResponse& response) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    if (absl::Status note = check_note(request.note()); !note.ok()) return note;
    if (request.data().size() > kMaxTextBytes)
        return absl::InvalidArgumentError(
            fmt::format("data has {} bytes; at most {} are allowed", request.data().size(), kMaxTextBytes));
    const auto cameras = parse_calibration(request.data(), request.format());
    if (!cameras.ok()) return absl::InvalidArgumentError(std::string(cameras.status().message()));
    Certificate certificate;
    certificate.method = "import";
    certificate.cameras = *cameras;
    certificate.world_defined = request.format() != v1::CALIBRATION_FORMAT_KALIBR;
    certificate.findings.push_back(
        {Verdict::kCaution, "not_checked", "", "this calibration was imported and has not been checked",
         "record a person walking through the space, and check the calibration with the recording"});
    const auto id = api.calibration.store->add(*cameras, certificate_json(certificate), certificate.method,
                                               certificate.verdict(), request.note(), utc_now_ns());
    if (!id.ok()) return id.status();
    response.set_calibration_id(*id);
    for (const Camera& camera : *cameras) response.add_cameras(camera.name);
    publish_change(api, fmt::format("calibration {} is imported", *id));
    return absl::OkStatus();
}

absl::Status export_calibration(const ApiContext& api, const v1::ExportCalibrationRequest& request,
                                v1::ExportCalibrationResponse& response) {
    const auto cameras = request.calibration_id().empty()
                             ? absl::StatusOr<std::vector<Camera>>(api.runner.cameras())
                             : api.calibration.store->cameras(request.calibration_id());
    if (!cameras.ok()) return cameras.status();
    switch (request.format()) {
        case v1::CALIBRATION_FORMAT_UNSPECIFIED:
        case v1::CALIBRATION_FORMAT_TOML:
            response.set_data(calibration_toml(*cameras));
            return absl::OkStatus();
        case v1::CALIBRATION_FORMAT_OPENCV:
            response.set_data(calibration_opencv_yaml(*cameras));
            return absl::OkStatus();
        case v1::CALIBRATION_FORMAT_KALIBR:
            if (const std::string problem = kalibr_problem(*cameras); !problem.empty())
                return absl::InvalidArgumentError(problem);
            response.set_data(calibration_kalibr_yaml(*cameras));
            return absl::OkStatus();
        default:
            return absl::InvalidArgumentError(
                fmt::format("calibrations cannot be exported in format {}; use TOML, OPENCV or KALIBR",
                            static_cast<int>(request.format())));
    }
}

absl::Status delete_calibration(const ApiContext& api, const v1::DeleteCalibrationRequest& request,
                                v1::DeleteCalibrationResponse&) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    return api.calibration.store->remove(request.calibration_id());
}

}  // namespace kinevox
