#include "server/api/calibration_handlers.h"

#include <fmt/format.h>

#include <algorithm>

#include "common/calibration_file.h"
#include "common/calibration_import.h"
#include "server/api/certificate_to_proto.h"
#include "server/api/replay_handlers.h"
#include "server/pipeline/utc_clock.h"

namespace kinevox {
namespace {

constexpr std::size_t kMaxNote = 200;
constexpr std::size_t kMaxText = 1 << 20;

void tell(const ApiContext& api, std::string message) {
    api.hub.publish_event({EventKind::kCalibration, 0, 0, {}, std::move(message)}, utc_now_ns());
}

absl::Status use_control(const ApiContext& api, const std::string& lease_id) {
    return api.lease.use(lease_id).status();
}

absl::Status check_note(const std::string& note) {
    if (note.size() > kMaxNote)
        return absl::InvalidArgumentError(
            fmt::format("the note has {} bytes; {} at most are allowed", note.size(), kMaxNote));
    if (std::ranges::any_of(note, [](unsigned char c) { return c < 0x20 || c == 0x7f; }))
        return absl::InvalidArgumentError(
            "the note holds a control character; write one line of printable ones");
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
        case v1::PROCEDURE_KIND_REFINE_PERSON:
            return ProcedureKind::kRefinePerson;
        default:
            return absl::InvalidArgumentError(fmt::format(
                "there is no procedure of kind {}; give INTRINSICS, EXTRINSICS_BOARD, EXTRINSICS_WAND or "
                "REFINE_PERSON",
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
        case ProcedureKind::kRefinePerson:
            return v1::PROCEDURE_KIND_REFINE_PERSON;
    }
    return v1::PROCEDURE_KIND_UNSPECIFIED;
}

absl::StatusOr<Taking> taking_of(v1::LiveObservations::What what) {
    switch (what) {
        case v1::LiveObservations::WHAT_UNSPECIFIED:
        case v1::LiveObservations::WHAT_MOVING:
            return Taking::kMoving;
        case v1::LiveObservations::WHAT_BOARD_ON_FLOOR:
            return Taking::kBoardOnFloor;
        case v1::LiveObservations::WHAT_EMPTY_SCENE:
            return Taking::kEmptyScene;
        case v1::LiveObservations::WHAT_PAUSE:
            return Taking::kNothing;
        default:
            return absl::InvalidArgumentError(fmt::format(
                "live observations cannot be {}; give MOVING, BOARD_ON_FLOOR, EMPTY_SCENE or PAUSE",
                static_cast<int>(what)));
    }
}

v1::LiveObservations::What to_proto(Taking taking) {
    switch (taking) {
        case Taking::kNothing:
            return v1::LiveObservations::WHAT_PAUSE;
        case Taking::kMoving:
            return v1::LiveObservations::WHAT_MOVING;
        case Taking::kBoardOnFloor:
            return v1::LiveObservations::WHAT_BOARD_ON_FLOOR;
        case Taking::kEmptyScene:
            return v1::LiveObservations::WHAT_EMPTY_SCENE;
    }
    return v1::LiveObservations::WHAT_UNSPECIFIED;
}

v1::ProcedureState to_proto(ProcedureState state) {
    switch (state) {
        case ProcedureState::kNone:
            return v1::PROCEDURE_STATE_NONE;
        case ProcedureState::kCollecting:
            return v1::PROCEDURE_STATE_COLLECTING;
        case ProcedureState::kReading:
            return v1::PROCEDURE_STATE_READING;
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
        case Verdict::kCare:
            return v1::VERDICT_CARE;
        case Verdict::kNoGo:
            return v1::VERDICT_NO_GO;
    }
    return v1::VERDICT_UNSPECIFIED;
}

// The cameras in use, with the lenses of the calibration that was asked for.
absl::StatusOr<std::vector<Camera>> cameras_with_lenses(const ApiContext& api,
                                                        const std::string& lenses_from) {
    std::vector<Camera> cameras = api.runner.cameras();
    if (lenses_from.empty()) return cameras;
    const auto lenses = api.calibrations->fitting_cameras(lenses_from);
    if (!lenses.ok()) return lenses.status();
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        const Rigid3 place = cameras[c].camera_from_world;
        cameras[c] = (*lenses)[c];
        cameras[c].camera_from_world = place;
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
                "there is no format {}; give TOML, OPENCV, KALIBR or QUALISYS", static_cast<int>(format)));
    }
}

// Refuses what would spoil the capture unless it is insisted upon.
absl::Status check_verdict(const ApiContext& api, const std::string& id) {
    const auto json = api.calibrations->certificate_json(id);
    if (!json.ok()) return json.status();
    const v1::Certificate certificate = certificate_to_proto(*json);
    if (certificate.verdict() == v1::VERDICT_NO_GO) {
        const auto worst = std::ranges::find_if(
            certificate.findings(),
            [](const v1::CertificateFinding& finding) { return finding.verdict() == v1::VERDICT_NO_GO; });
        return absl::FailedPreconditionError(
            fmt::format("calibration {} is NO-GO{}; calibrate anew, or insist with although_bad", id,
                        worst == certificate.findings().end() ? "" : ": " + worst->reason()));
    }
    if (!certificate.world_is_set())
        return absl::FailedPreconditionError(
            fmt::format("calibration {} has no world: nobody knows where the floor is; show the board on the "
                        "floor, or insist with "
                        "although_bad",
                        id));
    return absl::OkStatus();
}

std::string named(const std::string& id) {
    return id.empty() ? "the source's own calibration" : "calibration " + id;
}

std::string use_text(const CalibrationUse::Applied& applied) {
    return named(applied.id) +
           (applied.in_use ? " is in use" : " will be used from the capture's next start on");
}

}  // namespace

absl::Status check_calibration(const ApiContext& api) {
    if (api.calibrations && api.calibration_use && api.procedure && api.procedure_watch)
        return absl::OkStatus();
    return absl::FailedPreconditionError("this daemon cannot calibrate");
}

absl::Status start_procedure(const ApiContext& api, const v1::StartProcedureRequest& request,
                             v1::StartProcedureResponse& response) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    if (absl::Status live = check_live(api, "a calibration is of"); !live.ok()) return live;
    const auto kind = kind_of(request.kind());
    if (!kind.ok()) return kind.status();
    if (absl::Status note = check_note(request.note()); !note.ok()) return note;
    if (const auto there = api.calibrations->list(); !there.ok())
        return there.status();  // nowhere to store it
    ProcedureRequest wanted;
    wanted.kind = *kind;
    wanted.cameras = {request.cameras().begin(), request.cameras().end()};
    wanted.board = request.board();
    wanted.wand = request.wand();
    wanted.refine_lenses = request.refine_lenses();
    wanted.k3 = request.k3();
    wanted.subject_height_m = request.subject_height_m();
    wanted.note = request.note();
    const auto cameras = cameras_with_lenses(api, request.lenses_from());
    if (!cameras.ok()) return cameras.status();
    const auto number =
        api.procedure->start(wanted, *cameras, std::chrono::milliseconds(request.abandon_after_ms()));
    if (!number.ok()) return number.status();
    response.set_procedure(*number);
    return absl::OkStatus();
}

absl::Status add_observations(const ApiContext& api, const v1::AddObservationsRequest& request,
                              v1::AddObservationsResponse&) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    if (request.has_live()) {
        const auto what = taking_of(request.live().what());
        if (!what.ok()) return what.status();
        const RunState state = api.runner.state().state;
        if (*what != Taking::kNothing && state != RunState::kRunning && state != RunState::kLearning)
            return absl::FailedPreconditionError(
                "the capture does not run; start it to observe with its cameras");
        return api.procedure->take(*what);
    }
    if (!request.has_files())
        return absl::InvalidArgumentError("no observations are given; give live ones or files");
    ProcedureFiles files;
    for (const v1::CameraClip& clip : request.files().clips())
        files.clips.push_back({clip.camera(), clip.file(), {}});
    files.every = request.files().every() == 0 ? 1 : request.files().every();
    if (request.files().has_floor_frame()) files.floor_frame = request.files().floor_frame();
    files.session = request.files().session();
    return api.procedure->read(std::move(files));
}

absl::Status solve_procedure(const ApiContext& api, const v1::SolveProcedureRequest& request,
                             v1::SolveProcedureResponse&) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    return api.procedure->solve();
}

absl::Status cancel_procedure(const ApiContext& api, const v1::CancelProcedureRequest& request,
                              v1::CancelProcedureResponse&) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    return api.procedure->cancel(request.keep_observations());
}

v1::WatchProcedureResponse to_proto(const ProcedureProgress& progress) {
    v1::WatchProcedureResponse out;
    out.set_state(to_proto(progress.state));
    out.set_procedure(progress.number);
    out.set_part(progress.part);
    out.set_message(progress.message);
    out.set_verdict(to_proto(progress.verdict));
    out.set_calibration_id(progress.calibration_id);
    if (progress.number == 0) return out;
    out.set_kind(to_proto(progress.kind));
    out.set_live(progress.taking != Taking::kNothing);
    out.set_taking(to_proto(progress.taking));
    out.set_skipped(progress.skipped);
    const ProcedureReport& report = progress.report;
    *out.mutable_hints() = {report.hints.begin(), report.hints.end()};
    out.set_complete(report.complete);
    out.set_moments(report.moments);
    out.set_floor_seen(report.floor_seen);
    for (const ObservedCamera& camera : report.cameras) {
        v1::ObservedCamera& to = *out.add_cameras();
        to.set_name(camera.name);
        to.set_pictures(camera.pictures);
        to.set_accepted(camera.accepted);
        for (const auto& [reason, count] : camera.rejected) {
            v1::RejectedViews& rejected = *to.add_rejected();
            rejected.set_reason(reason);
            rejected.set_count(count);
        }
        to.set_coverage(camera.coverage);
        *to.mutable_coverage_counts() = {camera.coverage_counts.begin(), camera.coverage_counts.end()};
        to.set_seen_last(camera.seen_last);
        to.set_last_rejection(camera.last_rejection);
    }
    return out;
}

absl::Status list_calibrations(const ApiContext& api, const v1::ListCalibrationsRequest&,
                               v1::ListCalibrationsResponse& response) {
    const auto list = api.calibrations->list();
    if (!list.ok()) return list.status();
    const std::string in_use = api.calibration_use->in_use();
    for (const CalibrationListing& one : *list) {
        v1::CalibrationEntry& entry = *response.add_calibrations();
        entry.set_id(one.id);
        entry.set_time_ns(one.time_utc_ns);
        entry.set_made_by(one.made_by);
        entry.set_verdict(to_proto(one.verdict));
        entry.set_note(one.note);
        *entry.mutable_cameras() = {one.cameras.begin(), one.cameras.end()};
        entry.set_in_use(one.id == in_use);
        entry.set_fits(one.fits);
    }
    response.set_in_use(in_use);
    response.set_at_next_start(api.calibration_use->at_next_start());
    const std::vector<std::string> applied = api.calibrations->applied();
    response.set_can_undo(!applied.empty());
    if (applied.size() > 1) response.set_undo_to(applied[applied.size() - 2]);
    return absl::OkStatus();
}

absl::Status get_certificate(const ApiContext& api, const v1::GetCertificateRequest& request,
                             v1::GetCertificateResponse& response) {
    const auto json = api.calibrations->certificate_json(request.id());
    if (!json.ok()) return json.status();
    *response.mutable_certificate() = certificate_to_proto(*json);
    response.set_json(*json);
    if (!request.with_page()) return absl::OkStatus();
    auto page = api.calibrations->certificate_page(request.id());
    if (!page.ok()) return page.status();
    response.set_page_png(*std::move(page));
    return absl::OkStatus();
}

absl::Status apply_calibration(const ApiContext& api, const v1::ApplyCalibrationRequest& request,
                               v1::ApplyCalibrationResponse& response) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    if (absl::Status live = check_live(api, "a calibration is of"); !live.ok()) return live;
    if (absl::Status good = check_verdict(api, request.id());
        !good.ok() && !(request.although_bad() && absl::IsFailedPrecondition(good)))
        return good;
    const auto applied = api.calibration_use->apply(request.id(), request.restart_capture());
    if (!applied.ok()) return applied.status();
    response.set_in_use(applied->in_use);
    tell(api, use_text(*applied));
    return absl::OkStatus();
}

absl::Status undo_calibration(const ApiContext& api, const v1::UndoCalibrationRequest& request,
                              v1::UndoCalibrationResponse& response) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    if (absl::Status live = check_live(api, "a calibration is of"); !live.ok()) return live;
    const auto applied = api.calibration_use->undo(request.restart_capture());
    if (!applied.ok()) return applied.status();
    response.set_id(applied->id);
    response.set_in_use(applied->in_use);
    tell(api, "undone: " + use_text(*applied));
    return absl::OkStatus();
}

absl::Status import_calibration(const ApiContext& api, const v1::ImportCalibrationRequest& request,
                                v1::ImportCalibrationResponse& response) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    if (absl::Status note = check_note(request.note()); !note.ok()) return note;
    if (request.text().size() > kMaxText)
        return absl::InvalidArgumentError(fmt::format("the calibration has {} bytes; {} at most are read",
                                                      request.text().size(), kMaxText));
    const auto cameras = parse_calibration(request.text(), request.format());
    if (!cameras.ok()) return absl::InvalidArgumentError(std::string(cameras.status().message()));
    Certificate certificate;
    certificate.made_by = "import";
    certificate.cameras = *cameras;
    certificate.world_is_set = request.format() != v1::CALIBRATION_FORMAT_KALIBR;
    certificate.findings.push_back(
        {Verdict::kCare, "imported", "", "this calibration was imported and not checked here",
         "record a person who walks through the space, and check the recording with it"});
    const auto id = api.calibrations->add(*cameras, certificate_json(certificate), certificate.made_by,
                                          certificate.verdict(), request.note(), utc_now_ns());
    if (!id.ok()) return id.status();
    response.set_id(*id);
    for (const Camera& camera : *cameras) response.add_cameras(camera.name);
    tell(api, fmt::format("calibration {} is imported", *id));
    return absl::OkStatus();
}

absl::Status export_calibration(const ApiContext& api, const v1::ExportCalibrationRequest& request,
                                v1::ExportCalibrationResponse& response) {
    const auto stored = request.id().empty() ? absl::StatusOr<std::vector<Camera>>(api.runner.cameras())
                                             : api.calibrations->cameras(request.id());
    if (!stored.ok()) return stored.status();
    switch (request.format()) {
        case v1::CALIBRATION_FORMAT_UNSPECIFIED:
        case v1::CALIBRATION_FORMAT_TOML:
            response.set_text(calibration_toml(*stored));
            return absl::OkStatus();
        case v1::CALIBRATION_FORMAT_OPENCV:
            response.set_text(calibration_opencv_yaml(*stored));
            return absl::OkStatus();
        case v1::CALIBRATION_FORMAT_KALIBR:
            if (const std::string problem = kalibr_problem(*stored); !problem.empty())
                return absl::InvalidArgumentError(problem);
            response.set_text(calibration_kalibr_yaml(*stored));
            return absl::OkStatus();
        default:
            return absl::InvalidArgumentError(
                fmt::format("calibrations are not written in format {}; give TOML, OPENCV or KALIBR",
                            static_cast<int>(request.format())));
    }
}

absl::Status remove_calibration(const ApiContext& api, const v1::RemoveCalibrationRequest& request,
                                v1::RemoveCalibrationResponse&) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    return api.calibrations->remove(request.id());
}

}  // namespace kinevox
