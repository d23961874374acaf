// Whether the capture sees its cameras or a recording, and the handles of the latter.
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

// What is to change of a replay; what is absent stays as it is. Speed and loop first, then where, then
// whether it plays.
struct ReplayChange {
    std::optional<double> speed;
    std::optional<bool> loop;
    std::optional<std::int64_t> frame;  // seek
    std::optional<double> position_s;   // seek, to the nearest frame; without `frame`
    std::optional<std::int64_t> step;   // so many frames on, or back; pauses
    std::optional<bool> play;           // or pause
};

struct ReplayStatus {
    bool open = false;  // else the capture sees its cameras
    std::filesystem::path session_file;
    std::optional<ReplayPosition> position;  // empty while its source is not open
};

// open() and live() are the control thread's, as the runner's start() and stop(); the others any. A recording
// has a pipeline of its own, for its own cameras: the live one waits meanwhile, with its background, body and
// calibration.
class Replay {
  public:
    using MakePipeline = std::function<absl::StatusOr<std::unique_ptr<Pipeline>>(
        const std::vector<Camera>& cameras, double fps)>;
    // `tell`: one line for people, when a recording takes the cameras' place and when it gives it back.
    Replay(Runner& runner, MakePipeline make_pipeline, std::function<void(std::string)> tell);

    // Stops a capture that runs and starts it on the recording. Where that fails, all is as before.
    absl::Status open(const std::filesystem::path& session_file, const ReplayOptions& options);
    // Back to the cameras; they are captured again if they were before. FailedPrecondition where nothing is
    // replayed.
    absl::Status live();

    // FailedPrecondition where nothing is replayed; else as ReplaySource's.
    absl::Status change(const ReplayChange& change);
    ReplayStatus status() const;

  private:
    struct Shown {  // shared with what opens the source anew at each start
        mutable std::mutex mutex;
        std::shared_ptr<ReplaySource> source;  // null: not open
    };

    std::shared_ptr<ReplaySource> source() const;
    absl::Status stop_running(bool& ran);

    Runner& runner_;
    const MakePipeline make_pipeline_;
    const std::function<void(std::string)> tell_;

    std::optional<Feed> live_;  // the control thread's: waits while a recording is replayed
    bool live_ran_ = false;

    mutable std::mutex mutex_;
    std::shared_ptr<Shown> shown_;  // null: live
    std::filesystem::path session_file_;
};

}  // namespace kinevox
