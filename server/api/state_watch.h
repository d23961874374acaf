// Who follows something whose newest state alone is of interest: the building of the pose database, the fit
// of a body, a calibration procedure.
#pragma once

#include <absl/status/status.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "server/calibration/procedure.h"
#include "server/pipeline/mailbox.h"
#include "server/pose/database/database_service.h"
#include "server/pose/live_body_fit.h"

namespace kinevox {

// Any thread. A subscription lasts as long as the caller keeps the mailbox, which holds the newest word only.
template <typename State>
class StateWatch {
  public:
    using Box = Mailbox<State>;

    // Starts with what was published last.
    std::shared_ptr<Box> subscribe(std::function<void()> on_ready) {
        auto box = std::make_shared<Box>(MailboxOptions{}, std::move(on_ready));
        const std::scoped_lock lock(mutex_);
        box->put(newest_);
        if (!closed_.ok()) box->close(closed_);
        boxes_.push_back(box);
        return box;
    }

    void publish(const State& state) {
        const std::scoped_lock lock(mutex_);  // held while putting, so that nobody gets the older word last
        newest_ = state;
        std::erase_if(boxes_, [](const auto& box) { return box.expired(); });
        for (const auto& weak : boxes_)
            if (const auto box = weak.lock()) box->put(state);
    }

    bool watched() const {
        const std::scoped_lock lock(mutex_);
        return std::ranges::any_of(boxes_, [](const auto& box) { return !box.expired(); });
    }

    // Closes every mailbox, and whichever is subscribed to later. `why` is what the streams end with.
    void close(const absl::Status& why) {
        const std::scoped_lock lock(mutex_);
        closed_ = why;
        for (const auto& weak : boxes_)
            if (const auto box = weak.lock()) box->close(why);
    }

  private:
    mutable std::mutex mutex_;
    std::vector<std::weak_ptr<Box>> boxes_;
    State newest_;
    absl::Status closed_;
};

using DatabaseWatch = StateWatch<DatabaseProgress>;
using BodyWatch = StateWatch<BodyFitProgress>;
using ProcedureWatch = StateWatch<ProcedureProgress>;

}  // namespace kinevox
