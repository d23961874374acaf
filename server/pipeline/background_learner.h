// Collects live frame sets from which the background is learned.
#pragma once

#include <absl/status/status.h>

#include <chrono>
#include <cstddef>
#include <functional>
#include <mutex>
#include <optional>
#include <vector>

#include "server/cameras/frame_source.h"

namespace kinevox {

// Collected frame sets and the callback of the request.
struct CollectedBackground {
    int wanted = 0, seen = 0;
    std::vector<std::vector<Image>> images;  // per camera, of complete frame sets
    std::function<void(absl::Status)> done;

    bool sufficient() const { return static_cast<int>(images.front().size()) >= wanted; }
    // OK if sufficient, else FailedPrecondition with the number of complete frame sets.
    absl::Status check() const;
};

// Any thread. The receiver of a CollectedBackground calls its done().
class BackgroundLearner {
  public:
    using Clock = std::chrono::steady_clock;

    void begin(int wanted, std::size_t camera_count, std::function<void(absl::Status)> done);
    bool active() const;

    // The collection once it is sufficient, or once it cannot be expected to become so.
    std::optional<CollectedBackground> add(const FrameSet& frame_set);
    // The collection if no frame set was added for `idle_timeout`.
    std::optional<CollectedBackground> take_idle(std::chrono::milliseconds idle_timeout);
    // The collection so far, empty if none is active.
    std::optional<CollectedBackground> take();

  private:
    mutable std::mutex mutex_;
    std::optional<CollectedBackground> collected_;
    Clock::time_point latest_at_;  // of the begin or the latest frame set
};

}  // namespace kinevox
