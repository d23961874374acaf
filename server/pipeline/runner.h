// Drives the pipeline by three threads, each with one frame set in hand: the first takes it from the source,
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

#include "server/cameras/frame_source.h"
#include "server/pipeline/handover.h"
#include "server/pipeline/in_hand.h"
#include "server/pipeline/pipeline.h"
#include "server/pipeline/run_statistics.h"
#include "server/pipeline/stream_hub.h"
#include "server/pipeline/utc_clock.h"

namespace kinevox {

enum class RunState { kStopped, kStarting, kRunning, kLearning, kEnded, kFailed };
// Whether a capture runs or is about to.
bool is_active(RunState state);

// Who follows a run beside its results. None of them may wait.
struct Taps {
    std::function<void(const FrameSet&)>
        on_frame_set;  // each, as the source delivers it; on the fetching thread
    // Per camera the pictures that the background was learned from; on the thread that learned it.
    std::function<void(std::shared_ptr<const std::vector<std::vector<Picture>>>)> on_background;
    std::function<void()> on_end;  // no more frame sets and results of this run
};

// What a runner runs: a source and the pipeline that was made for its cameras.
struct Feed {
    std::shared_ptr<FrameSource> source;  // null: opened by `reopen`
    std::function<absl::StatusOr<std::shared_ptr<FrameSource>>()> reopen;
    std::unique_ptr<Pipeline> pipeline;
    double fps = 0;
    std::vector<Camera> own_cameras;                  // the source's
    std::vector<Camera> cameras;                      // in use
    std::optional<std::vector<Camera>> next_cameras;  // from the next start on
    bool background_learned = false;
    Taps taps;
};

// Threads: start(), stop() and learn_background() by one thread at a time (the daemon's control thread), they
// may take as long as the source does; abort(), state(), figures() by any. The hub must outlive the runner.
class Runner {
  public:
    using OpenSource = std::function<absl::StatusOr<std::unique_ptr<FrameSource>>()>;

    // `source` is used for the first start, `reopen` for later ones (a source delivers only once).
    Runner(std::unique_ptr<FrameSource> source, OpenSource reopen, std::unique_ptr<Pipeline> pipeline,
           StreamHub& hub);
    ~Runner();
    // Called on the posing thread after each result, before it is published; may touch the pose stage then.
    // To be set before the first start.
    void set_after_result(std::function<void(const FrameResult&)> after_result) {
        after_result_ = std::move(after_result);
    }
    // Of what runs now, a replay in between has none. To be set before the first start.
    void set_taps(Taps taps) { feed_.taps = std::move(taps); }
    Runner(const Runner&) = delete;
    Runner& operator=(const Runner&) = delete;

    // As the pipeline uses them, in the order of the frame set.
    std::vector<Camera> cameras() const;
    double source_fps() const;

    // Runs that one from the next start on; what it ran before, with all that was learned, for another time.
    // FailedPrecondition while it runs.
    absl::StatusOr<Feed> exchange(Feed feed);

    // Learns the background from the source's own clip where that has not been done, then starts the threads.
    // FailedPrecondition while it runs; else what the source or the pipeline said.
    absl::Status start();

    // Waits until the threads have ended. FailedPrecondition if nothing runs.
    absl::Status stop();

    // The same cameras, names, order and sizes, with another calibration than the source's own. True: in use
    // now; false: a capture runs, and takes them at its next start. The backgrounds stay learned.
    bool set_cameras(std::vector<Camera> cameras);
    // Called on the thread of set_cameras() or start() when other cameras were taken. To be set before the
    // first start.
    void set_on_cameras(std::function<void(const std::vector<Camera>&)> on_cameras) {
        on_cameras_ = std::move(on_cameras);
    }

    // `frames` > 0: from the next so many live frame sets, which yield no results meanwhile; 0: from the
    // source's own clip. `done` is called once, on this or one of the runner's threads: InvalidArgument,
    // FailedPrecondition (also where no frame set comes for the longest silence), Aborted by a stop, or what
    // the pipeline said.
    void learn_background(int frames, std::function<void(absl::Status)> done);
    // To be set before the first start; 10 s.
    void set_longest_silence(std::chrono::milliseconds longest) { max_silence_ = longest; }

    // For the daemon's end. Tells the source to stop, so that a start() in progress on another thread and the
    // runner's own threads end soon, and ends a learning in progress with Unavailable; nothing starts
    // afterwards. stop() is still to be called.
    void abort();

    struct State {
        RunState state = RunState::kStopped;
        std::string message;  // one line where there is something to say
    };
    State state() const;
    RunFigures figures() const { return statistics_.figures(); }
    // How long the frame set that is longest in the pipeline has been there; zero while it waits for one. Any
    // thread.
    std::chrono::nanoseconds max_in_hand(InHand::Clock::time_point now = InHand::Clock::now()) const;
    // Of a live source's cameras, in the order of cameras(); empty for other sources and while nothing runs.
    // Any thread.
    std::vector<CameraLink> camera_links() const;

    static constexpr int kMaxLearningFrames = 1000;
    static constexpr std::int64_t kMaxLearningBytes = std::int64_t{1}
                                                      << 30;  // of pictures held while learning

  private:
    struct Fetched {
        absl::StatusOr<FrameSet> frame_set;
        double waited_ms = 0;
    };
    struct Learning {
        int wanted = 0, seen = 0;
        std::chrono::steady_clock::time_point newest_at;  // or the begin, where none has come
        std::vector<std::vector<Picture>> pictures;       // per camera
        std::function<void(absl::Status)> done;
    };

    void take_cameras();
    absl::Status open_source();
    absl::Status learn_from_clip();
    void join_threads();
    void fetch_loop();
    void reconstruct_loop();
    void pose_loop();
    void end(const absl::Status& why);
    // Null for a frame set that the learning took.
    absl::StatusOr<std::unique_ptr<Reconstruction>> reconstruct(Fetched fetched);
    void publish(const FrameResultPtr& result);
    std::optional<Fetched> next_fetched();
    void collect(const FrameSet& frame_set);
    void give_up_silent_learning();
    void finish_learning(absl::Status status);
    void close_handovers();
    void set_state(RunState state, std::string message = {});
    void tell(EventKind kind, std::string message, std::uint64_t sequence = 0);
    void tell(const CameraEvent& event);
    std::shared_ptr<FrameSource> source() const;

    StreamHub& hub_;
    std::function<void(const FrameResult&)> after_result_;
    std::function<void(const std::vector<Camera>&)> on_cameras_;
    std::chrono::milliseconds max_silence_{10'000};  // cameras come back within a few seconds
    RunStatistics statistics_;

    mutable std::mutex mutex_;  // guards the members down to the blank line
    Feed feed_;                 // of which reopen, pipeline and own_cameras stay as they are while it runs
    State state_;
    bool aborted_ = false;
    std::optional<Learning> learning_;

    std::atomic<bool> live_ = false;  // the newest frame set fetched shows what happens now
    Handover<Fetched> fetched_;
    Handover<absl::StatusOr<std::unique_ptr<Reconstruction>>> reconstructed_;  // the last is why no more come

    std::optional<std::int64_t> utc_minus_capture_ns_;  // of this run; the posing thread's own, and so are
    ClockSteps clock_steps_;                            // those since
    std::thread fetch_thread_, reconstruct_thread_, pose_thread_;
    InHand reconstructing_, posing_;
};

}  // namespace kinevox
