// A calibration procedure from its start to a stored calibration, step by step with the running capture. No
// Qt.
#pragma once

#include <absl/status/status.h>

#include <functional>
#include <mutex>
#include <stop_token>
#include <string>

#include "kinevox/v1/calibration_service.pb.h"

namespace kinevox::client {
class Client;
}

namespace kinevox::viewer {

enum class CalibrationStep { kNone, kStarting, kEmptyScene, kBoardOnFloor, kMoving, kSolving };

struct CalibrationPlan {
    v1::StartProcedureRequest what;  // without a lease
    bool floor = false;              // boards: first the board lies on the floor
};

// run() occupies its thread; enough() and stop() come from any other.
class CalibrationRun {
  public:
    using OnStep = std::function<void(CalibrationStep)>;
    using OnProgress = std::function<void(const v1::WatchProcedureResponse&)>;

    // `on_lack`: what the solving lacked; the looking goes on then until enough().
    using OnLack = std::function<void(const std::string&)>;

    CalibrationRun(CalibrationPlan plan, OnStep on_step, OnProgress on_progress, OnLack on_lack);

    // Takes control under `operator_name` for each call, not for the whole time: the coach goes on using the
    // daemon. Leaves no open procedure behind. The stored calibration's id in `id`; Cancelled after stop().
    absl::Status run(client::Client& client, const std::string& operator_name, std::string& id);
    // What was seen is enough: solve it. While it is not moving yet, the next step begins.
    void enough();
    void stop();

  private:
    using Progress = v1::WatchProcedureResponse;

    absl::Status prepare();
    absl::Status look(bool until_complete);
    absl::Status solve(std::string& id);
    absl::Status take(CalibrationStep step, v1::LiveObservations::What what,
                      const std::function<bool(const Progress&)>& over);
    // Until it is so; `skippable`: or until enough().
    absl::Status watch(const std::function<bool(const Progress&)>& over, bool skippable);
    absl::Status under_control(const std::function<absl::Status(const std::string& lease_id)>& act);

    const CalibrationPlan plan_;
    const OnStep on_step_;
    const OnProgress on_progress_;
    const OnLack on_lack_;
    client::Client* client_ = nullptr;
    std::string operator_name_;
    Progress last_;

    std::mutex mutex_;          // guards those below
    std::stop_source looking_;  // ends the watching that goes on now
    bool stopped_ = false, enough_ = false;
};

}  // namespace kinevox::viewer
