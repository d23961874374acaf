#include "server/calibration/calibration_use.h"

#include <fmt/format.h>

#include <utility>

namespace kinevox {

CalibrationUse::CalibrationUse(CalibrationStore& store, Runner& runner,
                               std::function<void(const std::vector<Camera>&)> on_taken)
    : store_(store), runner_(runner), on_taken_(std::move(on_taken)) {
    runner_.set_on_cameras([this](const std::vector<Camera>& cameras) {
        {
            const std::scoped_lock lock(mutex_);
            in_use_ = next_;
        }
        on_taken_(cameras);
    });
}

absl::Status CalibrationUse::begin() {
    const std::string id = store_.in_use();
    if (id.empty()) return absl::OkStatus();
    return take(id, false).status();
}

absl::StatusOr<CalibrationUse::Applied> CalibrationUse::apply(const std::string& id, bool restart) {
    if (const absl::Status applied = store_.apply(id); !applied.ok()) return applied;
    return take(id, restart);
}

absl::StatusOr<CalibrationUse::Applied> CalibrationUse::undo(bool restart) {
    const auto id = store_.undo();
    if (!id.ok()) return id.status();
    return take(*id, restart);
}

absl::StatusOr<CalibrationUse::Applied> CalibrationUse::take(const std::string& id, bool restart) {
    auto cameras = store_.fitting_cameras(id);
    if (!cameras.ok()) return cameras.status();
    {
        const std::scoped_lock lock(mutex_);
        next_ = id;
    }
    if (runner_.set_cameras(*std::move(cameras))) {
        const std::scoped_lock lock(mutex_);
        in_use_ = id;  // the same cameras may have two names
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

std::string CalibrationUse::in_use() const {
    const std::scoped_lock lock(mutex_);
    return in_use_;
}

std::string CalibrationUse::at_next_start() const {
    const std::scoped_lock lock(mutex_);
    return next_;
}

}  // namespace kinevox
