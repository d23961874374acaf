// The calibration procedure of the daemon: one at a time, from start to a stored calibration or its end.
//
// A thread of low priority takes frame sets from a mailbox that holds the newest only, so that the pipeline
// never waits for it; it reads files and solves, too. Whoever watches or calls keeps a procedure alive:
// without both it ends by itself.
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

#include "server/calibration/procedure_work.h"
#include "server/pipeline/stream_hub.h"

namespace kinevox {

enum class ProcedureState { kNone, kCollecting, kReading, kSolving, kSolved, kCancelled, kFailed };

struct ProcedureProgress {
    ProcedureState state = ProcedureState::kNone;
    std::uint64_t number = 0;  // counts from 1; 0: there was none
    ProcedureKind kind = ProcedureKind::kIntrinsics;
    double part = 0;      // of the reading or solving, 0 to 1
    std::string message;  // what it does, or how the last step ended
    ProcedureReport report;
    Taking taking = Taking::kNothing;  // from the running capture
    std::uint64_t skipped = 0;         // frame sets that came meanwhile
    std::string calibration_id;        // once solved
    std::optional<Verdict> verdict;    // once solved

    bool open() const {
        return state == ProcedureState::kCollecting || state == ProcedureState::kReading ||
               state == ProcedureState::kSolving;
    }
};

struct ProcedureOptions {
    std::chrono::milliseconds abandon_after{60'000};  // where nobody says otherwise
    std::chrono::milliseconds max_abandon_after{3'600'000};
    std::chrono::milliseconds silence{3'000};  // without a frame set, until a hint says so
};

// Any thread, but not from within its own callbacks. Those come from any thread and must only pass the word
// on.
class CalibrationProcedure {
  public:
    using OnProgress = std::function<void(const ProcedureProgress&)>;
    // The newest results of the running capture.
    using Subscribe = std::function<std::shared_ptr<PictureMailbox>(std::function<void()> on_ready)>;
    // Stores what was solved and returns its id.
    using Store =
        std::function<absl::StatusOr<std::string>(const Certificate& certificate, const std::string& note)>;
    // Whether somebody watches.
    using Watched = std::function<bool()>;

    CalibrationProcedure(Subscribe subscribe, Store store, Watched watched, OnProgress on_progress,
                         const ProcedureOptions& options = {});
    ~CalibrationProcedure();
    CalibrationProcedure(const CalibrationProcedure&) = delete;
    CalibrationProcedure& operator=(const CalibrationProcedure&) = delete;

    // Its number. `cameras`: all of the daemon's, in its order, with the lenses to use. FailedPrecondition
    // while another is open; else as ProcedureWork::create(). `abandon_after` 0: the default.
    absl::StatusOr<std::uint64_t> start(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                                        std::chrono::milliseconds abandon_after);
    // FailedPrecondition without an open procedure or while it reads or solves; ResourceExhausted when it
    // keeps as much as it can; InvalidArgument and NotFound for what this kind does not take.
    absl::Status take(Taking what);
    absl::Status read(ProcedureFiles files);
    absl::Status solve();
    // FailedPrecondition without an open procedure; with `keep_observations` also while there is nothing to
    // stop.
    absl::Status cancel(bool keep_observations);

    ProcedureProgress progress() const;
    // For the daemon's end: nothing is begun afterwards.
    void close();

  private:
    using Clock = std::chrono::steady_clock;
    enum class Job { kNone, kRead, kSolve };

    absl::Status check_collecting() const;  // mutex held
    bool abandoned();                       // mutex held
    // Mutex held; what they return is to be let go without.
    std::shared_ptr<PictureMailbox> begin(Job job, ProcedureState state, std::string message);
    std::shared_ptr<PictureMailbox> end(ProcedureState state, std::string message);
    void tell();
    void run();
    void guarded(std::uint64_t number, const std::function<void()>& act);
    void read_files(std::uint64_t number, ProcedureWork& work, const ProcedureFiles& files);
    void solve_observed(std::uint64_t number, ProcedureWork& work, const std::string& note);
    void look_at_newest();
    SolveProgress progress_of(std::uint64_t number);

    const Subscribe subscribe_;
    const Store store_;
    const Watched watched_;
    const OnProgress on_progress_;
    const ProcedureOptions options_;

    mutable std::mutex
        mutex_;  // guards the members down to the blank line; never held while the hub is called
    std::condition_variable changed_;
    ProcedureProgress progress_;
    std::shared_ptr<ProcedureWork>
        work_;  // null: none is open. Its methods are the worker's, but for the checks
    std::string note_;
    ProcedureFiles files_;                 // of the job
    Job job_ = Job::kNone;                 // to be done
    bool stop_job_ = false;                // the one being done
    std::shared_ptr<PictureMailbox> box_;  // while taking
    Clock::time_point last_use_, last_frame_set_;
    Clock::duration abandon_after_{};
    bool closed_ = false;

    std::mutex telling_;  // held while on_progress_ is called, so that nobody gets the older word last
    std::atomic<bool> ready_ = false;  // the mailbox may have something
    std::thread worker_;
};

}  // namespace kinevox
