// The stored calibration that the capture uses, and its change while the daemon runs.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "server/calibration/procedure/calibration_store.h"
#include "server/pipeline/runner.h"

namespace kinevox {

// restore(), apply() and undo() run on the control thread, as the runner's start() and stop(); active() and
// pending() on any. Store and runner must outlive it.
class ActiveCalibration {
  public:
    // `on_applied`: called on the control thread whenever the capture uses other cameras.
    ActiveCalibration(CalibrationStore& store, Runner& runner,
                      std::function<void(const std::vector<Camera>&)> on_applied);

    // Before the first start: uses what was applied last. An error says why the source's own calibration is
    // used instead.
    absl::Status restore();

    struct Applied {
        std::string id;       // empty: the source's own
        bool active = false;  // false: from the capture's next start
    };
    // `restart`: restarts a running capture. Aborted if the capture does not start again; the calibration
    // stays applied.
    absl::StatusOr<Applied> apply(const std::string& id, bool restart);
    absl::StatusOr<Applied> undo(bool restart);

    std::string active() const;   // id; empty: the source's own
    std::string pending() const;  // the same as active() where nothing waits

  private:
    absl::StatusOr<Applied> use(const std::string& id, bool restart);

    CalibrationStore& store_;
    Runner& runner_;
    const std::function<void(const std::vector<Camera>&)> on_applied_;
    mutable std::mutex mutex_;
    std::string active_, pending_;
};

}  // namespace kinevox
