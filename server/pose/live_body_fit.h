// Fits the body model to the captured subject in the background: on request, and automatically from the first
// seconds with a subject.
//
// Threads: the pipeline calls observe() and take_fit(), any thread the others. The callback may come from
// any thread and must not call back into this class.
#pragma once

#include <absl/status/status.h>

#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "server/pose/body_fitter.h"

namespace kinevox {

enum class BodyFitState { kNotStarted, kCollecting, kFitting, kReady, kFailed };

struct BodyFitProgress {
    BodyFitState state = BodyFitState::kNotStarted;
    double progress = 0;                // of collecting, then of fitting, 0..1
    bool requested = false;             // false: started automatically
    std::string message;                // the result; one line
    BodyShape body;                     // the active one
    std::optional<BodyFit> fit;         // of the active body; empty: it is the initial one
    std::filesystem::path stored_path;  // body.toml of that fit; empty: not stored
};

struct LiveBodyFitOptions {
    bool automatic = true;  // fits to the first seconds with a subject
    double automatic_duration_s = 6;
    std::filesystem::path file;  // stores bodies fitted on request; empty: does not store
    BodyFitOptions fit;
};

class LiveBodyFit {
  public:
    using OnProgress = std::function<void(const BodyFitProgress&)>;

    // `posing` as in the pipeline; each fit starts from its body.
    LiveBodyFit(std::vector<Camera> cameras, double fps, const PoseStageOptions& posing,
                const LiveBodyFitOptions& options, OnProgress on_progress = {});
    ~LiveBodyFit();
    LiveBodyFit(const LiveBodyFit&) = delete;
    LiveBodyFit& operator=(const LiveBodyFit&) = delete;

    // Bounds and default of start()'s duration.
    static constexpr double kDefaultSeconds = 4;
    static constexpr double kMinSeconds = 1, kMaxSeconds = 30;
    // Fits to the next `seconds` with a subject; cancels a running fit. InvalidArgument outside the bounds
    // above, Unavailable after close().
    absl::Status start(double seconds);

    // Call after each frame set; null: no subject. Copies at most 30 observations per second.
    void observe(std::int64_t time_ns, const PoseObservation* seen);
    // Another calibration of the same cameras. Drops collected observations; a running fit continues with the
    // previous calibration. Must not be concurrent with observe().
    void set_cameras(std::vector<Camera> cameras);
    // The fit since the last call, if any.
    std::optional<BodyFit> take_fit();

    BodyFitProgress progress() const;
    // For shutdown: cancels; nothing is fitted afterwards.
    void close();

  private:
    using Frames = std::vector<std::unique_ptr<PoseObservation>>;
    using Cameras = std::shared_ptr<const std::vector<Camera>>;  // the frames point into them
    struct ToFit {
        Cameras cameras;
        Frames frames;
        bool store = false;
    };
    struct Collecting {
        double seconds = 0;
        bool requested = false;
        // Capture times of the request and of the first and latest observation kept.
        std::optional<std::int64_t> requested_ns, first_ns, last_ns;
        Frames frames;
    };

    void begin(double seconds, bool requested);
    void keep(std::int64_t time_ns, const PoseObservation& seen);
    void fit_loop();
    void fit(const ToFit& job, std::stop_token stop);
    void report();

    const double fps_;
    const PoseStageOptions posing_;
    const LiveBodyFitOptions options_;
    const OnProgress on_progress_;

    mutable std::mutex mutex_;  // guards the members down to the blank line
    std::condition_variable changed_;
    Cameras cameras_;
    BodyFitProgress progress_;
    std::optional<Collecting> collecting_;
    std::optional<ToFit> to_fit_;
    std::stop_source stop_;  // of the running fit
    std::optional<BodyFit> fresh_;
    int attempts_left_ = 0;  // automatic ones
    bool closed_ = false;

    std::int64_t last_time_ns_ = 0;  // observe()'s own
    std::thread worker_;
};

}  // namespace kinevox
