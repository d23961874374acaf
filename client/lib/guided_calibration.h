// A calibration procedure from its start to a stored calibration, step by step, with the daemon's live
// cameras or with files on its machine. Shared by the viewer and the command line.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>

#include "client/lib/client.h"

namespace kinevox::client {

class HeldControl;

enum class CalibrationStep {
    kNone,
    kStarting,
    kReadingFiles,
    kEmptyScene,
    kBoardOnFloor,
    kMovingTarget,
    kSolving
};

struct CalibrationPlan {
    v1::StartProcedureRequest procedure;           // without a lease
    bool board_on_floor = false;                   // first capture the board on the floor
    std::optional<v1::FileObservations> files;     // instead of the live cameras
    std::chrono::milliseconds moving_duration{0};  // of the moving target; 0: until coverage suffices
    bool hold_control = false;  // throughout; false: for each call, so that the operator can act
};

// Called on run()'s thread. Unset functions are not called.
struct CalibrationObserver {
    std::function<void(CalibrationStep)> on_step;
    std::function<bool(const v1::WatchProcedureResponse&)> on_progress;  // false ends the procedure
    // Why the observations do not suffice to solve; collection continues until finish_step(). Unset: that is
    // an error.
    std::function<void(const std::string&)> on_insufficient;
};

// run() occupies its thread; finish_step() and stop() may be called from any other.
class GuidedCalibration {
  public:
    GuidedCalibration(CalibrationPlan plan, CalibrationObserver observer);
    ~GuidedCalibration();

    // The id of the stored calibration; Cancelled after stop(). Leaves no open procedure behind.
    absl::StatusOr<std::string> run(Client& client, const std::string& operator_name);
    // Ends the current collection step: the next step begins, or solving.
    void finish_step();
    void stop();

    // Under the control of run() while it holds it, else under control for this call.
    absl::Status with_control(const std::function<absl::Status(const Lease&)>& act);

  private:
    using Progress = v1::WatchProcedureResponse;
    using Condition = std::function<bool(const Progress&)>;

    absl::StatusOr<std::string> run_procedure();
    absl::Status start_procedure();
    absl::Status read_files();
    absl::Status prepare();
    absl::Status collect_moving(bool until_sufficient);
    absl::Status collect(CalibrationStep step, v1::LiveObservations::Step live_step, const Condition& over);
    absl::StatusOr<std::string> solve();
    void cancel_procedure();
    // Until `over`; `skippable`: or until finish_step().
    absl::Status watch(const Condition& over, bool skippable);
    void set_step(CalibrationStep step);

    const CalibrationPlan plan_;
    const CalibrationObserver observer_;
    Client* client_ = nullptr;
    std::string operator_name_;
    std::unique_ptr<HeldControl> control_;  // null: acquired for each call
    Progress latest_;

    std::mutex mutex_;           // guards the following
    std::stop_source watching_;  // ends the current watch_procedure()
    bool stopped_ = false, finish_step_ = false;
};

// Whether the procedure collects, reads or solves.
bool is_open(const v1::WatchProcedureResponse& progress);

// "NO-GO"; `unjudged` where there is no verdict.
std::string verdict_text(v1::Verdict verdict, const char* unjudged);
// "extrinsics from a board"; the words of the certificate's page, too.
std::string method_text(v1::CalibrationMethod method);
// A finding on one line: camera, reason, remedy.
std::string finding_line(const v1::CertificateFinding& finding);

}  // namespace kinevox::client
