// The daemon's calibration procedure: one at a time, from start to a stored calibration or its end.
//
// A low-priority thread reads the latest frame set from a mailbox, so that the pipeline never waits; it also
// reads files and solves. Watchers and calls keep a procedure open; without either it ends after a timeout.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "server/calibration/procedure/procedure_work.h"
#include "server/pipeline/stream_hub.h"

namespace kinevox {

enum class ProcedureState { kNone, kCollecting, kReading, kSolving, kSolved, kCancelled, kFailed };

struct ProcedureProgress {
    ProcedureState state = ProcedureState::kNone;
    std::uint64_t number = 0;  // counts from 1; 0: there was none
    ProcedureKind kind = ProcedureKind::kIntrinsics;
    double progress = 0;  // of reading or solving, 0 to 1
    std::string message;  // current step, or the result of the last one
    ProcedureReport report;
    LiveStep live_step = LiveStep::kPause;      // of the running capture
    std::uint64_t skipped_frame_set_count = 0;  // frame sets that arrived meanwhile
    std::string calibration_id;                 // once solved
    std::optional<Verdict> verdict;             // once solved

    bool open() const {
        return state == ProcedureState::kCollecting || state == ProcedureState::kReading ||
               state == ProcedureState::kSolving;
    }
};

struct ProcedureOptions {
    std::chrono::milliseconds idle_timeout{60'000};  // default
    std::chrono::milliseconds max_idle_timeout{3'600'000};
    std::chrono::milliseconds frame_set_timeout{3'000};  // without a frame set, until a message reports it
};

// Any thread, but not from within its own callbacks. Those come from any thread and must only notify.
class CalibrationProcedure {
  public:
    using OnProgress = std::function<void(const ProcedureProgress&)>;
    // The latest results of the running capture.
    using Subscribe = std::function<std::shared_ptr<ImageMailbox>(std::function<void()> on_ready)>;
    // Stores the result and returns its id.
    using Store =
        std::function<absl::StatusOr<std::string>(const Certificate& certificate, const std::string& note)>;
    // True while a client watches.
    using Watched = std::function<bool()>;

    CalibrationProcedure(Subscribe subscribe, Store store, Watched watched, OnProgress on_progress,
                         const ProcedureOptions& options = {});
    ~CalibrationProcedure();
    CalibrationProcedure(const CalibrationProcedure&) = delete;
    CalibrationProcedure& operator=(const CalibrationProcedure&) = delete;

    // Returns its number. `cameras`: all of the daemon's, in its order, with the intrinsics to use.
    // FailedPrecondition while another is open; else as ProcedureWork::create(). `idle_timeout` 0: the
    // default.
    absl::StatusOr<std::uint64_t> start(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                                        std::chrono::milliseconds idle_timeout);
    // FailedPrecondition without an open procedure or while it reads or solves; ResourceExhausted if it is
    // full; InvalidArgument and NotFound for input that this kind does not use.
    absl::Status collect_live(LiveStep step);
    absl::Status read(ProcedureFiles files);
    absl::Status solve();
    // FailedPrecondition without an open procedure; with `keep_observations` also if nothing is running.
    absl::Status cancel(bool keep_observations);

    ProcedureProgress progress() const;
    // Before the daemon ends: starts no further work.
    void close();

  private:
    using Clock = std::chrono::steady_clock;
    enum class Job { kNone, kRead, kSolve };

    absl::Status check_collecting() const;  // mutex held
    bool timed_out();                       // mutex held
    // Mutex held; the caller releases the returned mailbox without it.
    std::shared_ptr<ImageMailbox> begin(Job job, ProcedureState state, std::string message);
    std::shared_ptr<ImageMailbox> end(ProcedureState state, std::string message);
    void notify();
    void run();
    void guarded(std::uint64_t number, const std::function<void()>& act);
    void read_files(std::uint64_t number, ProcedureWork& work, const ProcedureFiles& files);
    void solve_observed(std::uint64_t number, ProcedureWork& work, const std::string& note);
    void process_latest();
    SolveProgress progress_of(std::uint64_t number);

    const Subscribe subscribe_;
    const Store store_;
    const Watched watched_;
    const OnProgress on_progress_;
    const ProcedureOptions options_;

    mutable std::mutex mutex_;  // guards the members down to the blank line; not held during calls to the hub
    std::condition_variable changed_;
    ProcedureProgress progress_;
    std::shared_ptr<ProcedureWork>
        work_;  // null: none is open. Only the worker calls it, except for the checks
    std::string note_;
    ProcedureFiles files_;               // of the job
    Job job_ = Job::kNone;               // pending
    bool stop_job_ = false;              // cancels the running job
    std::shared_ptr<ImageMailbox> box_;  // while collecting
    Clock::time_point last_use_, last_frame_set_;
    Clock::duration idle_timeout_{};
    bool closed_ = false;

    std::mutex notifying_;             // held during on_progress_, so that messages arrive in order
    std::atomic<bool> ready_ = false;  // the mailbox may hold a message
    std::thread worker_;
};

}  // namespace kinevox
