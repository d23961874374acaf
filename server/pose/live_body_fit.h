// Fits the body model to the captured subjects in the background: on request, and automatically from the
// first seconds with a subject. Until then preliminary fits to what was seen so far.
//
// Threads: the pipeline calls observe() and body_in_use(), any thread the others. The callbacks may come
// from any thread and must not call back into this class.
#pragma once

#include <absl/status/status.h>

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "server/pose/body_fitter.h"

namespace kinevox {

enum class BodyFitState { kNotStarted, kCollecting, kFitting, kReady, kFailed };

struct BodyFitProgress {
    std::uint32_t subject_id = 0;  // 0: of the next subject, while none is tracked
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
    // Others precede it after these times, ascending, unless the one before still runs; short movements, such
    // as a sprinter's start, end before the automatic one.
    std::vector<double> preliminary_durations_s{0, 0.1, 0.25, 0.5, 1, 2, 4};
    std::filesystem::path file;  // stores bodies fitted on request; empty: does not store
    // Several at once, each with a body of its own. Otherwise a requested body is that of all, and an
    // automatic one that of its subject: the next person begins with it, until another is fitted.
    bool several_subjects = false;
    BodyFitOptions fit;
};

class LiveBodyFit {
  public:
    struct Observers {
        std::function<void(const std::vector<BodyFitProgress>&)> on_progress;  // as progress()
        std::function<void(const BodyFitProgress&)> on_end;  // of one fit, which is ready or has failed
    };

    // `posing` as in the pipeline; each fit starts from its body.
    LiveBodyFit(std::vector<Camera> cameras, double fps, const PoseStageOptions& posing,
                const LiveBodyFitOptions& options, Observers observers = {});
    ~LiveBodyFit();
    LiveBodyFit(const LiveBodyFit&) = delete;
    LiveBodyFit& operator=(const LiveBodyFit&) = delete;

    // Bounds and default of start()'s duration.
    static constexpr double kDefaultSeconds = 4;
    static constexpr double kMinSeconds = 1, kMaxSeconds = 30;
    // Fits to the next `seconds` with a subject, 0: the next one to appear; cancels a running fit of it.
    // InvalidArgument outside the bounds above, Unavailable after close().
    absl::Status start(std::uint32_t subject_id, double seconds);

    struct Seen {
        std::uint32_t subject_id = 0;
        const PoseObservation* observation = nullptr;  // null: the frame set does not show it
        const BodyPosture* posture = nullptr;          // tracked with the body in use; null: none was found
    };
    // Call after each frame set with those tracked. Copies at most 30 observations per second of each.
    void observe(std::int64_t time_ns, std::span<const Seen> tracked);
    // The next frame set is of another run, whose ids are of other subjects.
    void capture_ended();
    // The silhouettes have changed: repeats automatic fits. The bodies in use stay until the next preliminary
    // ones are there.
    void refit();
    // The silhouettes are again those before refit(), and so are the bodies.
    void undo_refit();
    // The subject's body is one from before refit(), which is to be replaced.
    bool awaits_refit(std::uint32_t subject_id) const;
    // Another calibration of the same cameras. Drops collected observations; a running fit continues with the
    // previous calibration. Must not be concurrent with observe().
    void set_cameras(std::vector<Camera> cameras);
    BodyInUse body_in_use(std::uint32_t subject_id) const;

    // Of each subject tracked, ordered by id, and of one that left while a requested fit waited for it; at
    // least one.
    std::vector<BodyFitProgress> progress() const;
    // For shutdown: cancels; nothing is fitted afterwards.
    void close();

  private:
    struct Frame {
        std::shared_ptr<const PoseObservation> seen;
        std::optional<BodyPosture> posture;
    };
    using Frames = std::vector<Frame>;
    static constexpr std::size_t kMaxSubjects = 64;  // remembered, gone ones included
    static std::vector<const PoseObservation*> observations_of(const Frames& frames);
    using Cameras = std::shared_ptr<const std::vector<Camera>>;  // the frames point into them
    struct ToFit {
        std::uint32_t key = 0;  // of the subject in subjects_
        Cameras cameras;
        Frames frames;
        BodyShape start;
        // 1, 2, ...: a preliminary fit, more frames of the same subject are being collected; 0: of all
        // frames.
        int preliminary = 0;
        bool store = false;
        std::stop_token stop;
    };
    struct Collecting {
        double seconds = 0;
        bool requested = false;
        std::size_t preliminary_times = 0;  // passed, of the options'
        int preliminary_count = 0;          // of the fits begun
        // Capture times of the request and of the first and latest observation kept.
        std::optional<std::int64_t> requested_ns, first_ns, last_ns;
        Frames frames;
    };

    struct Subject {
        BodyFitProgress progress;
        std::optional<Collecting> collecting;
        std::stop_source stop;  // of the running fit
        int attempts_left = 0;  // automatic ones
        std::optional<std::int64_t> gone_since_ns;
        bool is_preliminary = false;    // the body in use
        bool is_unsettled = false;      // it is the first preliminary one
        bool preliminary_runs = false;  // or waits to run
        bool awaits_refit = false;      // the next preliminary body replaces even that of the same person
        std::optional<BodyFitProgress> before_refit;
    };
    using Ended = std::vector<BodyFitProgress>;  // to be passed on without the mutex

    // With the mutex held. True: the progress changed.
    void begin(std::uint32_t key, double seconds, bool requested);
    void cancel(std::uint32_t key);
    void fail(Subject& subject, std::string message, Ended& ended);
    void keep(std::uint32_t key, std::int64_t time_ns, const Seen& seen);
    void begin_preliminary(std::uint32_t key);
    void enqueue(std::uint32_t key, Frames frames, int preliminary);
    bool restart();
    Subject& subject_of(std::uint32_t key);
    bool observe_one(std::uint32_t key, std::int64_t time_ns, const Seen& seen, Ended& ended);
    bool observe_several(std::int64_t time_ns, std::span<const Seen> tracked, Ended& ended);
    bool observe_lone(std::int64_t time_ns, std::span<const Seen> tracked, Ended& ended);
    bool change_lone(std::uint32_t id);
    bool observe_gone(std::int64_t time_ns, std::span<const Seen> tracked, Ended& ended);
    bool is_reported(std::uint32_t key, const Subject& subject) const;

    void fit_loop(bool preliminary);
    void fit(const ToFit& job);
    std::optional<BodyFit> fit_preliminary(const ToFit& job) const;
    bool use_preliminary(const ToFit& job, const std::optional<BodyFit>& fit);
    void report(const Ended& ended);

    const double fps_;
    const PoseStageOptions posing_;
    const LiveBodyFitOptions options_;
    const Observers observers_;

    mutable std::mutex mutex_;  // guards the members down to the blank line
    std::condition_variable changed_;
    Cameras cameras_;
    // By id. 0 is always there: the only one of several_subjects = false, else the next to appear.
    std::map<std::uint32_t, Subject> subjects_;
    // Without several_subjects: who was tracked last in this run (0: none yet), and automatic fits by id.
    std::uint32_t lone_id_ = 0;
    std::map<std::uint32_t, BodyFitProgress> lone_fits_;
    std::deque<ToFit> to_fit_;
    bool closed_ = false, run_ended_ = false;
    std::int64_t last_time_ns_ = 0;

    std::thread worker_, preliminary_worker_;
};

}  // namespace kinevox
