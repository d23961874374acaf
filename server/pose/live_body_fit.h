// The body of whoever is captured, fitted behind the running capture: when somebody asks, and by itself from
// the first seconds in which a person is seen.
//
// Threads: observe() and take_body() the pipeline's, everything else any. The callback comes from any of them
// and must not call back into this class.
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

enum class BodyFitState { kNone, kCollecting, kFitting, kReady, kFailed };

struct BodyFitProgress {
    BodyFitState state = BodyFitState::kNone;
    double part = 0;                  // of collecting, then of fitting, 0..1
    bool asked = false;               // else it began by itself
    std::string message;              // what came of it; one line
    BodyShape body;                   // in use
    std::optional<BodyFit> fit;       // the one in use; empty: the body is the one from the start
    std::filesystem::path stored_in;  // body.toml of that fit; empty: nowhere
};

struct LiveBodyFitOptions {
    bool by_itself = true;  // from the first seconds with a person
    double seconds_by_itself = 6;
    std::filesystem::path file;  // where a body that was asked for is stored; empty: nowhere
    BodyFitOptions fit;
};

class LiveBodyFit {
  public:
    using OnProgress = std::function<void(const BodyFitProgress&)>;

    // `posing` as the pipeline's; its body is where each fit starts.
    LiveBodyFit(std::vector<Camera> cameras, double fps, const PoseStageOptions& posing,
                const LiveBodyFitOptions& options, OnProgress on_progress = {});
    ~LiveBodyFit();
    LiveBodyFit(const LiveBodyFit&) = delete;
    LiveBodyFit& operator=(const LiveBodyFit&) = delete;

    // Bounds and the default of what start() takes.
    static constexpr double kUsualSeconds = 4;
    static constexpr double kMinSeconds = 1, kMaxSeconds = 30;
    // Fits to what is seen in the next `seconds` with a person; a fit under way gives way. InvalidArgument
    // beyond the bounds above, Unavailable after close().
    absl::Status start(double seconds);

    // After each frame set: what was seen, null where nobody was. Copies some of them, at most 30 a second.
    void observe(std::int64_t time_ns, const PoseObservation* seen);
    // Other places and lenses of the same cameras. What was collected so far is dropped; a fit under way goes
    // on with the cameras that its frames were seen by. While observe() is not called.
    void set_cameras(std::vector<Camera> cameras);
    // A body that was fitted since the last call.
    std::optional<BodyShape> take_body();

    BodyFitProgress progress() const;
    // For the daemon's end: cancels; nothing is fitted afterwards.
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
        bool asked = false;
        std::optional<std::int64_t> asked_ns, first_ns,
            last_ns;  // capture times of the first and the newest kept
        Frames frames;
    };

    void begin(double seconds, bool asked);
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
    std::stop_source stop_;  // of the fit under way
    std::optional<BodyShape> fresh_;
    int attempts_left_ = 0;  // by itself
    bool closed_ = false;

    std::int64_t last_time_ns_ = 0;  // observe()'s own
    std::thread worker_;
};

}  // namespace kinevox
