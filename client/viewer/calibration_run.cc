#include "client/viewer/calibration_run.h"

#include <chrono>
#include <utility>

#include "client/lib/client.h"

namespace kinevox::viewer {
namespace {

constexpr std::chrono::minutes kMaxSilence{
    10};  // some steps of a solve on a busy machine have nothing to tell

bool is_open(const v1::WatchProcedureResponse& progress) {
    return progress.state() == v1::PROCEDURE_STATE_COLLECTING ||
           progress.state() == v1::PROCEDURE_STATE_READING || progress.state() == v1::PROCEDURE_STATE_SOLVING;
}

}  // namespace

CalibrationRun::CalibrationRun(CalibrationPlan plan, OnStep on_step, OnProgress on_progress, OnLack on_lack)
    : plan_(std::move(plan)),
      on_step_(std::move(on_step)),
      on_progress_(std::move(on_progress)),
      on_lack_(std::move(on_lack)) {}

void CalibrationRun::enough() {
    const std::scoped_lock lock(mutex_);
    enough_ = true;
    looking_.request_stop();
}

void CalibrationRun::stop() {
    const std::scoped_lock lock(mutex_);
    stopped_ = true;
    looking_.request_stop();
}

absl::Status CalibrationRun::run(client::Client& client, const std::string& operator_name, std::string& id) {
    client_ = &client;
    operator_name_ = operator_name;
    on_step_(CalibrationStep::kStarting);
    absl::Status done = under_control([&](const std::string& lease_id) {
        v1::StartProcedureRequest request = plan_.what;
        request.set_lease_id(lease_id);
        return client_->start_procedure(request).status();
    });
    if (done.ok()) {
        done = prepare();
        if (done.ok()) done = look(true);
        if (done.ok()) done = solve(id);
        while (absl::IsFailedPrecondition(done) && last_.state() == v1::PROCEDURE_STATE_COLLECTING) {
            on_lack_(std::string(done.message()));
            done = look(false);
            if (done.ok()) done = solve(id);
        }
        if (!done.ok())
            under_control([&](const std::string& lease_id) {
                v1::CancelProcedureRequest cancel;
                cancel.set_lease_id(lease_id);
                return client_->cancel_procedure(cancel).status();
            }).IgnoreError();  // it may have ended by itself
    }
    on_step_(CalibrationStep::kNone);
    return done;
}

absl::Status CalibrationRun::under_control(const std::function<absl::Status(const std::string&)>& act) {
    return client_->under_control(operator_name_, act);
}

absl::Status CalibrationRun::watch(const std::function<bool(const Progress&)>& over, bool skippable) {
    client::StreamOptions options;
    options.max_silence = kMaxSilence;
    {
        const std::scoped_lock lock(mutex_);
        if (stopped_) return absl::CancelledError("stopped; nothing was stored");
        looking_ = {};
        if (enough_ && skippable) looking_.request_stop();
        options.stop = looking_.get_token();
    }
    for (;;) {
        bool reached = false;
        const absl::Status status = client_->watch_procedure(
            [&](const Progress& progress) {
                last_ = progress;
                on_progress_(progress);
                reached = over(progress);
                return !reached && is_open(progress);
            },
            options);
        {
            const std::scoped_lock lock(mutex_);
            if (stopped_) return absl::CancelledError("stopped; nothing was stored");
            const bool asked = std::exchange(enough_, false);
            if (asked && skippable) return absl::OkStatus();
            if (asked) {  // it cannot be hurried
                looking_ = {};
                options.stop = looking_.get_token();
                continue;
            }
        }
        if (!status.ok()) return status;
        return reached ? absl::OkStatus() : absl::AbortedError(last_.message());
    }
}

absl::Status CalibrationRun::take(CalibrationStep step, v1::LiveObservations::What what,
                                  const std::function<bool(const Progress&)>& over) {
    const absl::Status taken = under_control([&](const std::string& lease_id) {
        v1::AddObservationsRequest request;
        request.set_lease_id(lease_id);
        request.mutable_live()->set_what(what);
        return client_->add_observations(request).status();
    });
    if (!taken.ok()) return taken;
    on_step_(step);
    return watch(over, step != CalibrationStep::kEmptyScene);
}

absl::Status CalibrationRun::prepare() {
    absl::Status done;
    if (plan_.what.kind() == v1::PROCEDURE_KIND_EXTRINSICS_WAND)
        done = take(CalibrationStep::kEmptyScene, v1::LiveObservations::WHAT_EMPTY_SCENE,
                    [](const Progress& p) { return !p.live(); });
    if (done.ok() && plan_.floor)
        done = take(CalibrationStep::kBoardOnFloor, v1::LiveObservations::WHAT_BOARD_ON_FLOOR,
                    [](const Progress& p) { return p.floor_seen() && !p.live(); });
    return done;
}

absl::Status CalibrationRun::look(bool until_complete) {
    return take(CalibrationStep::kMoving, v1::LiveObservations::WHAT_MOVING,
                [=](const Progress& p) { return (until_complete && p.complete()) || !p.live(); });
}

absl::Status CalibrationRun::solve(std::string& id) {
    absl::Status done = under_control([&](const std::string& lease_id) {
        v1::SolveProcedureRequest request;
        request.set_lease_id(lease_id);
        return client_->solve_procedure(request).status();
    });
    if (!done.ok()) return done;
    on_step_(CalibrationStep::kSolving);
    done = watch([](const Progress& p) { return p.state() != v1::PROCEDURE_STATE_SOLVING; }, false);
    if (!done.ok()) return done;
    if (last_.state() != v1::PROCEDURE_STATE_SOLVED) return absl::FailedPreconditionError(last_.message());
    id = last_.calibration_id();
    return absl::OkStatus();
}

}  // namespace kinevox::viewer
