#include "client/lib/guided_calibration.h"

#include <utility>

#include "client/lib/client_parts.h"
#include "common/procedure_messages.h"

namespace kinevox::client {
namespace {

// Some steps of a solve on a busy machine report nothing for minutes.
constexpr std::chrono::minutes kIdleTimeout{10};

absl::Status stopped_error() {
    return absl::CancelledError("stopped; nothing was stored");
}

}  // namespace

bool is_open(const v1::WatchProcedureResponse& progress) {
    return progress.state() == v1::PROCEDURE_STATE_COLLECTING ||
           progress.state() == v1::PROCEDURE_STATE_READING_FILES ||
           progress.state() == v1::PROCEDURE_STATE_SOLVING;
}

GuidedCalibration::GuidedCalibration(CalibrationPlan plan, CalibrationObserver observer)
    : plan_(std::move(plan)), observer_(std::move(observer)) {}

GuidedCalibration::~GuidedCalibration() = default;

void GuidedCalibration::finish_step() {
    const std::scoped_lock lock(mutex_);
    finish_step_ = true;
    watching_.request_stop();
}

void GuidedCalibration::stop() {
    const std::scoped_lock lock(mutex_);
    stopped_ = true;
    watching_.request_stop();
}

absl::StatusOr<std::string> GuidedCalibration::run(Client& client, const std::string& operator_name) {
    client_ = &client;
    operator_name_ = operator_name;
    set_step(CalibrationStep::kStarting);
    if (plan_.hold_control) {
        auto held = HeldControl::acquire(client, operator_name);
        if (!held.ok()) return held.status();
        control_ = *std::move(held);
    }
    auto id = run_procedure();
    set_step(CalibrationStep::kNone);
    return id;
}

absl::StatusOr<std::string> GuidedCalibration::run_procedure() {
    if (absl::Status started = start_procedure(); !started.ok()) return started;
    absl::Status done = plan_.files ? read_files() : prepare();
    if (done.ok() && !plan_.files) done = collect_moving(true);
    absl::StatusOr<std::string> id = done.ok() ? solve() : absl::StatusOr<std::string>(done);
    while (observer_.on_insufficient && absl::IsFailedPrecondition(id.status()) &&
           latest_.state() == v1::PROCEDURE_STATE_COLLECTING) {
        observer_.on_insufficient(std::string(id.status().message()));
        done = collect_moving(false);
        id = done.ok() ? solve() : absl::StatusOr<std::string>(done);
    }
    if (!id.ok()) cancel_procedure();
    return id;
}

absl::Status GuidedCalibration::with_control(const std::function<absl::Status(const Lease&)>& act) {
    return control_ ? act(control_->lease()) : client_->with_control(operator_name_, act);
}

absl::Status GuidedCalibration::start_procedure() {
    return with_control([&](const Lease& lease) {
        v1::StartProcedureRequest request = plan_.procedure;
        request.set_lease_id(lease.id);
        return client_->start_procedure(request).status();
    });
}

void GuidedCalibration::cancel_procedure() {
    with_control([&](const Lease& lease) {
        v1::CancelProcedureRequest cancel;
        cancel.set_lease_id(lease.id);
        return client_->cancel_procedure(cancel).status();
    }).IgnoreError();  // it may have ended already
}

void GuidedCalibration::set_step(CalibrationStep step) {
    if (observer_.on_step) observer_.on_step(step);
}

absl::Status GuidedCalibration::watch(const Condition& over, bool skippable) {
    StreamOptions options;
    options.idle_timeout = kIdleTimeout;
    {
        const std::scoped_lock lock(mutex_);
        if (stopped_) return stopped_error();
        watching_ = {};
        if (finish_step_ && skippable) watching_.request_stop();
        options.stop = watching_.get_token();
    }
    for (;;) {
        bool reached = false, read = true;
        const absl::Status status = client_->watch_procedure(
            [&](const Progress& progress) {
                latest_ = progress;
                if (observer_.on_progress) read = observer_.on_progress(progress);
                reached = over(progress);
                return read && !reached && is_open(progress);
            },
            options);
        {
            const std::scoped_lock lock(mutex_);
            if (stopped_) return stopped_error();
            const bool finish = std::exchange(finish_step_, false);
            if (finish && skippable) return absl::OkStatus();
            if (finish) {  // this step cannot be shortened
                watching_ = {};
                options.stop = watching_.get_token();
                continue;
            }
        }
        if (!status.ok()) return status;
        if (!read) return absl::AbortedError("the reader of the progress has left");
        return reached ? absl::OkStatus() : absl::AbortedError(latest_.message());
    }
}

absl::Status GuidedCalibration::read_files() {
    const absl::Status added = with_control([&](const Lease& lease) {
        v1::AddObservationsRequest request;
        request.set_lease_id(lease.id);
        *request.mutable_files() = *plan_.files;
        return client_->add_observations(request).status();
    });
    if (!added.ok()) return added;
    set_step(CalibrationStep::kReadingFiles);
    if (absl::Status read =
            watch([](const Progress& p) { return p.state() == v1::PROCEDURE_STATE_COLLECTING; }, false);
        !read.ok())
        return read;
    // Where files cannot be read, the procedure collects again, with the reason as its message.
    return latest_.message() == kFilesReadMessage ? absl::OkStatus() : absl::AbortedError(latest_.message());
}

absl::Status GuidedCalibration::collect(CalibrationStep step, v1::LiveObservations::Step live_step,
                                        const Condition& over) {
    const absl::Status added = with_control([&](const Lease& lease) {
        v1::AddObservationsRequest request;
        request.set_lease_id(lease.id);
        request.mutable_live()->set_step(live_step);
        return client_->add_observations(request).status();
    });
    if (!added.ok()) return added;
    set_step(step);
    return watch(over, step != CalibrationStep::kEmptyScene);
}

absl::Status GuidedCalibration::prepare() {
    absl::Status done;
    if (plan_.procedure.kind() == v1::PROCEDURE_KIND_EXTRINSICS_WAND)
        done = collect(CalibrationStep::kEmptyScene, v1::LiveObservations::STEP_EMPTY_SCENE,
                       [](const Progress& p) { return !p.collecting_live(); });
    if (done.ok() && plan_.board_on_floor)
        done = collect(CalibrationStep::kBoardOnFloor, v1::LiveObservations::STEP_BOARD_ON_FLOOR,
                       [](const Progress& p) { return p.floor_defined() && !p.collecting_live(); });
    return done;
}

absl::Status GuidedCalibration::collect_moving(bool until_sufficient) {
    const auto begin = std::chrono::steady_clock::now();
    const auto over = [&](const Progress& p) {
        if (!p.collecting_live()) return true;
        if (plan_.moving_duration.count() > 0)
            return std::chrono::steady_clock::now() - begin >= plan_.moving_duration;
        return until_sufficient && p.sufficient();
    };
    return collect(CalibrationStep::kMovingTarget, v1::LiveObservations::STEP_MOVING_TARGET, over);
}

absl::StatusOr<std::string> GuidedCalibration::solve() {
    absl::Status done = with_control([&](const Lease& lease) {
        v1::SolveProcedureRequest request;
        request.set_lease_id(lease.id);
        return client_->solve_procedure(request).status();
    });
    if (!done.ok()) return done;
    set_step(CalibrationStep::kSolving);
    done = watch([](const Progress& p) { return p.state() != v1::PROCEDURE_STATE_SOLVING; }, false);
    if (!done.ok()) return done;
    if (latest_.state() != v1::PROCEDURE_STATE_SOLVED)
        return absl::FailedPreconditionError(latest_.message());
    return latest_.calibration_id();
}

std::string verdict_text(v1::Verdict verdict, const char* unjudged) {
    switch (verdict) {
        case v1::VERDICT_GO:
            return "GO";
        case v1::VERDICT_CAUTION:
            return "CAUTION";
        case v1::VERDICT_NO_GO:
            return "NO-GO";
        default:
            return unjudged;
    }
}

std::string method_text(v1::CalibrationMethod method) {
    switch (method) {
        case v1::CALIBRATION_METHOD_INTRINSICS_BOARD:
            return "intrinsics from a board";
        case v1::CALIBRATION_METHOD_EXTRINSICS_BOARD:
            return "extrinsics from a board";
        case v1::CALIBRATION_METHOD_EXTRINSICS_WAND:
            return "extrinsics from a wand";
        case v1::CALIBRATION_METHOD_PERSON:
            return "silhouettes of a person";
        case v1::CALIBRATION_METHOD_IMPORT:
            return "imported";
        default:
            return "unknown method";
    }
}

std::string finding_line(const v1::CertificateFinding& finding) {
    const bool named =
        finding.camera().empty() || finding.reason().find(finding.camera()) != std::string::npos;
    return fmt::format("{}{}{}{}", named ? "" : "camera " + finding.camera() + ": ", finding.reason(),
                       finding.remedy().empty() ? "" : "; ", finding.remedy());
}

}  // namespace kinevox::client
