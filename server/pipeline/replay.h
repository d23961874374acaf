// Replays a recorded session instead of the cameras.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "server/cameras/replay_source.h"
#include "server/pipeline/runner.h"

namespace kinevox {

// Changes of a replay, applied in this order; absent: unchanged.
struct ReplayChange {
    std::optional<double> speed;
    std::optional<bool> loop;
    std::optional<std::int64_t> frame;  // seek
    std::optional<double> position_s;   // seek, to the nearest frame; without `frame`
    std::optional<std::int64_t> step;   // frames forward or back; pauses
    std::optional<bool> play;           // false: pause
};

struct ReplayStatus {
    bool open = false;  // false: the cameras are captured
    std::filesystem::path session_file;
    std::optional<ReplayPosition> position;  // empty while its source is closed
};

// open() and close() are the control thread's, as the runner's start() and stop(); the others any. A replay
// has its own pipeline for its own cameras; the live one keeps its background, body and calibration.
class Replay {
  public:
    using MakePipeline = std::function<absl::StatusOr<std::unique_ptr<Pipeline>>(
        const std::vector<Camera>& cameras, double fps)>;
    // `on_change`: with kReplayOpened or kReplayClosed and one line for people.
    using OnChange = std::function<void(EventKind, std::string message)>;
    Replay(Runner& runner, MakePipeline make_pipeline, OnChange on_change);

    // Stops a running capture and starts it with the session. On failure the previous state is restored.
    absl::Status open(const std::filesystem::path& session_file, const ReplayOptions& options);
    // Back to the cameras; they are captured again if they were before. FailedPrecondition if nothing is
    // replayed.
    absl::Status close();

    // FailedPrecondition if nothing is replayed; else as ReplaySource's.
    absl::Status change(const ReplayChange& change);
    ReplayStatus status() const;

  private:
    struct SourceSlot {  // shared with the function that reopens the source at each start
        mutable std::mutex mutex;
        std::shared_ptr<ReplaySource> source;  // null: not open
    };

    std::shared_ptr<ReplaySource> source() const;
    absl::Status stop_running(bool& ran);

    Runner& runner_;
    const MakePipeline make_pipeline_;
    const OnChange on_change_;

    std::optional<CaptureSetup> live_;  // the control thread's: the setup of the cameras during a replay
    bool live_ran_ = false;

    mutable std::mutex mutex_;
    std::shared_ptr<SourceSlot> slot_;  // null: live
    std::filesystem::path session_file_;
};

}  // namespace kinevox
