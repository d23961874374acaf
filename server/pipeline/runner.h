// Drives the pipeline with three threads, each busy with one frame set: the first fetches it from the source,
// the second reconstructs the volume, the third finds the pose and publishes the result.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/utc_clock.h"
#include "server/cameras/frame_source.h"
#include "server/pipeline/background_learner.h"
#include "server/pipeline/handover.h"
#include "server/pipeline/pipeline.h"
#include "server/pipeline/run_statistics.h"
#include "server/pipeline/stream_hub.h"

namespace kinevox {

enum class RunState { kStopped, kStarting, kRunning, kLearning, kEnded, kFailed };
// Whether a capture is running or starting.
bool is_active(RunState state);

// Observers of a run besides the subscribers of its results. None of them may block.
struct RunObservers {
    std::function<void(const FrameSet&)> on_frame_set;  // each one that the source delivers; fetching thread
    // Per camera the images that the background was learned from; on the thread that learned it.
    std::function<void(std::shared_ptr<const std::vector<std::vector<Image>>>)> on_background;
    std::function<void()> on_end;  // no more frame sets and results of this run
};

// What a runner captures: a source and the pipeline that was made for its cameras.
struct CaptureSetup {
    std::shared_ptr<FrameSource> source;  // null: opened by `reopen`
    std::function<absl::StatusOr<std::shared_ptr<FrameSource>>()> reopen;
    std::unique_ptr<Pipeline> pipeline;
    double fps = 0;
    std::vector<Camera> own_cameras;                  // the source's
    std::vector<Camera> cameras;                      // active
    std::optional<std::vector<Camera>> next_cameras;  // from the next start
    bool background_learned = false;
    std::vector<std::vector<Image>> background,
        previous_background;  // per camera, a selection of each's images
    RunObservers observers;
};

// Threads: start(), stop() and learn_background() by one thread at a time (the daemon's control thread), they
// may take as long as the source does; abort(), state(), snapshot() by any. The hub must outlive the runner.
class Runner {
  public:
    using OpenSource = std::function<absl::StatusOr<std::unique_ptr<FrameSource>>()>;

    // `source` is used for the first start, `reopen` for later ones (a source delivers only once).
    Runner(std::unique_ptr<FrameSource> source, OpenSource reopen, std::unique_ptr<Pipeline> pipeline,
           StreamHub& hub);
    ~Runner();
    // Called on the posing thread after each result, before it is published; may access the pose stage.
    // Set before the first start.
    void set_result_observer(std::function<void(const FrameResult&)> observer) {
        result_observer_ = std::move(observer);
    }
    // Of the present setup; a replay in between has none. Set before the first start.
    void set_observers(RunObservers observers) { setup_.observers = std::move(observers); }
    Runner(const Runner&) = delete;
    Runner& operator=(const Runner&) = delete;

    // As the pipeline uses them, in the order of the frame set.
    std::vector<Camera> cameras() const;
    double source_fps() const;

    // Captures `setup` from the next start; returns the previous one with everything that was learned.
    // FailedPrecondition while it captures.
    absl::StatusOr<CaptureSetup> swap_setup(CaptureSetup setup);

    // Learns the background from the source's background images unless it is learned, then starts the
    // threads. FailedPrecondition while it captures; else the error of the source or the pipeline.
    absl::Status start();

    // Waits until the threads have ended. FailedPrecondition if nothing is captured.
    absl::Status stop();

    // The same cameras, names, order and sizes, with another calibration than the source's. True: active now;
    // false: from the next start, because a capture is running. The backgrounds stay learned.
    bool set_cameras(std::vector<Camera> cameras);
    // Called on the thread of set_cameras() or start() when other cameras became active. Set before the first
    // start.
    void set_on_cameras(std::function<void(const std::vector<Camera>&)> on_cameras) {
        on_cameras_ = std::move(on_cameras);
    }

    // `frame_set_count` > 0: from the next N live frame sets, which yield no results; 0: from the source's
    // background images. `done` is called once, on this or one of the runner's threads: InvalidArgument,
    // FailedPrecondition (also without a frame set for the idle timeout), Aborted by a stop, or the
    // pipeline's error.
    void learn_background(int frame_set_count, std::function<void(absl::Status)> done);
    // Learns again from the images of the background before the last one; a second call changes back.
    // FailedPrecondition while it captures, or without one.
    absl::Status restore_background();
    // Set before the first start; 10 s.
    void set_idle_timeout(std::chrono::milliseconds timeout) { idle_timeout_ = timeout; }

    // For the daemon's shutdown. Stops the source, so that a start() in progress on another thread and the
    // runner's own threads end soon, and ends learning with Unavailable; nothing starts afterwards. stop()
    // must still be called.
    void abort();

    struct State {
        RunState state = RunState::kStopped;
        std::string message;  // one line, or empty
    };
    State state() const;
    // Of the present setup's pipeline; null unless it follows several subjects. Any thread.
    std::shared_ptr<SubjectControl> subject_control() const;
    RunSnapshot snapshot() const { return statistics_.snapshot(); }
    // For how long the pipeline has been busy with its oldest frame set; zero while it waits for one. Any
    // thread.
    std::chrono::nanoseconds max_busy_time(BusyTimer::Clock::time_point now = BusyTimer::Clock::now()) const;
    // Of a live source's cameras, in the order of cameras(); empty for other sources and while nothing is
    // captured. Any thread.
    std::vector<CameraConnection> camera_connections() const;

    static constexpr int kMaxLearningFrames = 1000;
    // Of the images held while learning.
    static constexpr std::int64_t kMaxLearningBytes = std::int64_t{1} << 30;
    // Images per camera kept of a learned background, an even selection.
    static constexpr std::size_t kKeptBackgroundImages = 16;

  private:
    struct Fetched {
        absl::StatusOr<FrameSet> frame_set;
        double waited_ms = 0;
    };
    void take_cameras();
    absl::Status open_source();
    absl::Status learn_from_clip();
    void join_threads();
    void fetch_loop();
    void reconstruct_loop();
    void pose_loop();
    void end(const absl::Status& why);
    // Null for a frame set that was used for learning.
    absl::StatusOr<std::unique_ptr<Reconstruction>> reconstruct(Fetched fetched);
    void publish(const FrameResultPtr& result);
    std::optional<Fetched> next_fetched();
    void learn_from(const FrameSet& frame_set);
    void keep_background(const std::vector<std::vector<Image>>& images);
    void end_idle_learning();
    void end_learning(absl::Status status);
    bool background_learned() const;
    void close_handovers();
    void set_state(RunState state, std::string message = {});
    void publish_event(EventKind kind, std::string message, std::uint64_t sequence = 0);
    void publish_event(const CameraEvent& event);
    std::shared_ptr<FrameSource> source() const;

    StreamHub& hub_;
    std::function<void(const FrameResult&)> result_observer_;
    std::function<void(const std::vector<Camera>&)> on_cameras_;
    std::chrono::milliseconds idle_timeout_{10'000};  // cameras reconnect within a few seconds
    RunStatistics statistics_;
    BackgroundLearner learner_;

    mutable std::mutex mutex_;  // guards the members down to the blank line
    CaptureSetup setup_;        // reopen, pipeline and own_cameras do not change while it captures
    State state_;
    bool aborted_ = false;

    std::atomic<bool> live_ = false;  // the latest frame set fetched is of the present
    Handover<Fetched> fetched_;
    Handover<absl::StatusOr<std::unique_ptr<Reconstruction>>> reconstructed_;  // ends with an error

    std::optional<std::int64_t> utc_minus_capture_ns_;  // of this run; the posing thread's own, as are
    ClockSteps clock_steps_;                            // the steps since
    std::thread fetch_thread_, reconstruct_thread_, pose_thread_;
    BusyTimer reconstructing_, posing_;
};

}  // namespace kinevox
