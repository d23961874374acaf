#include "server/calibration/procedure/active_calibration.h"

#include <fmt/format.h>

#include <utility>

namespace kinevox {

ActiveCalibration::ActiveCalibration(CalibrationStore& store, Runner& runner,
                                     std::function<void(const std::vector<Camera>&)> on_applied)
    : store_(store), runner_(runner), on_applied_(std::move(on_applied)) {
    runner_.set_on_cameras([this](const std::vector<Camera>& cameras) {
        {
            const std::scoped_lock lock(mutex_);
            active_ = pending_;
        }
        on_applied_(cameras);
    });
}

absl::Status ActiveCalibration::restore() {
    const std::string id = store_.active();
    if (id.empty()) return absl::OkStatus();
    return use(id, false).status();
}

absl::StatusOr<ActiveCalibration::Applied> ActiveCalibration::apply(const std::string& id, bool restart) {
    if (const absl::Status applied = store_.apply(id); !applied.ok()) return applied;
    return use(id, restart);
}

absl::StatusOr<ActiveCalibration::Applied> ActiveCalibration::undo(bool restart) {
    const auto id = store_.undo();
    if (!id.ok()) return id.status();
    return use(*id, restart);
}

absl::StatusOr<ActiveCalibration::Applied> ActiveCalibration::use(const std::string& id, bool restart) {
    auto cameras = store_.compatible_cameras(id);
    if (!cameras.ok()) return cameras.status();
    {
        const std::scoped_lock lock(mutex_);
        pending_ = id;
    }
    if (runner_.set_cameras(*std::move(cameras))) {
        const std::scoped_lock lock(mutex_);
        active_ = id;  // two calibrations may have equal cameras
        return Applied{id, true};
    }
    if (!restart) return Applied{id, false};
    absl::Status back = runner_.stop();
    if (back.ok() || absl::IsFailedPrecondition(back)) back = runner_.start();  // it may have ended meanwhile
    if (!back.ok())
        return absl::AbortedError(
            fmt::format("the calibration is applied, but the capture did not start with it: {}",
                        std::string(back.message())));
    return Applied{id, true};
}

std::string ActiveCalibration::active() const {
    const std::scoped_lock lock(mutex_);
    return active_;
}

std::string ActiveCalibration::pending() const {
    const std::scoped_lock lock(mutex_);
    return pending_;
}

}  // namespace kinevox
