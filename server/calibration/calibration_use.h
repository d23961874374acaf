// Which stored calibration the capture uses, and its change while the daemon runs.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "server/calibration/calibration_store.h"
#include "server/pipeline/runner.h"

namespace kinevox {

// begin(), apply() and undo() are the control thread's, as the runner's start() and stop(); in_use() and
// at_next_start() any. Store and runner must outlive it.
class CalibrationUse {
  public:
    // `on_taken`: whenever the capture has taken other cameras, on the control thread.
    CalibrationUse(CalibrationStore& store, Runner& runner,
                   std::function<void(const std::vector<Camera>&)> on_taken);

    // Before the first start: takes what was applied before. An error says why the source's own is used
    // instead.
    absl::Status begin();

    struct Applied {
        std::string id;       // empty: the source's own
        bool in_use = false;  // false: from the capture's next start on
    };
    // `restart`: a capture that runs is stopped and started with it. Aborted where it does not come back up;
    // the calibration is applied all the same.
    absl::StatusOr<Applied> apply(const std::string& id, bool restart);
    absl::StatusOr<Applied> undo(bool restart);

    std::string in_use() const;         // id; empty: the source's own
    std::string at_next_start() const;  // the same as in_use() where nothing waits

  private:
    absl::StatusOr<Applied> take(const std::string& id, bool restart);

    CalibrationStore& store_;
    Runner& runner_;
    const std::function<void(const std::vector<Camera>&)> on_taken_;
    mutable std::mutex mutex_;
    std::string in_use_, next_;
};

}  // namespace kinevox
