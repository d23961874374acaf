#include "server/calibration/procedure/procedure.h"

#include <fmt/format.h>
#include <oneapi/tbb/task_arena.h>

#include <exception>
#include <utility>

#include "common/background_priority.h"
#include "common/one_line.h"
#include "common/procedure_messages.h"

namespace kinevox {
namespace {

constexpr std::chrono::milliseconds kTick{100};  // maximum delay until a timeout or a frame set is noticed

const char* in_words(ProcedureKind kind) {
    switch (kind) {
        case ProcedureKind::kIntrinsics:
            return "intrinsics from a board";
        case ProcedureKind::kExtrinsicsBoard:
            return "extrinsics from a board";
        case ProcedureKind::kExtrinsicsWand:
            return "extrinsics from a wand";
        case ProcedureKind::kExtrinsicsRefinePerson:
            return "extrinsics refined from a person";
    }
    return "";
}

double seconds(std::chrono::steady_clock::duration duration) {
    return std::chrono::duration<double>(duration).count();
}

}  // namespace

CalibrationProcedure::CalibrationProcedure(Subscribe subscribe, Store store, Watched watched,
                                           OnProgress on_progress, const ProcedureOptions& options)
    : subscribe_(std::move(subscribe)),
      store_(std::move(store)),
      watched_(std::move(watched)),
      on_progress_(std::move(on_progress)),
      options_(options) {
    worker_ = std::thread([this] { run(); });
}

CalibrationProcedure::~CalibrationProcedure() {
    close();
    worker_.join();
}

void CalibrationProcedure::close() {
    std::shared_ptr<ImageMailbox> box;
    {
        const std::scoped_lock lock(mutex_);
        closed_ = stop_job_ = true;
        box = std::move(box_);
    }
    changed_.notify_all();
}

ProcedureProgress CalibrationProcedure::progress() const {
    const std::scoped_lock lock(mutex_);
    return progress_;
}

void CalibrationProcedure::notify() {
    const std::scoped_lock notifying(notifying_);
    on_progress_(progress());
}

absl::StatusOr<std::uint64_t> CalibrationProcedure::start(const ProcedureRequest& request,
                                                          const std::vector<Camera>& cameras,
                                                          std::chrono::milliseconds idle_timeout) {
    if (idle_timeout.count() < 0 || idle_timeout > options_.max_idle_timeout)
        return absl::InvalidArgumentError(
            fmt::format("idle_timeout is {} ms; 1 to {} is allowed, or 0 for {}", idle_timeout.count(),
                        options_.max_idle_timeout.count(), options_.idle_timeout.count()));
    auto work = ProcedureWork::create(request, cameras);
    if (!work.ok()) return work.status();
    std::uint64_t number = 0;
    {
        const std::scoped_lock lock(mutex_);
        if (closed_) return absl::UnavailableError("the daemon is stopping; nothing is calibrated");
        if (progress_.open())
            return absl::FailedPreconditionError(
                fmt::format("another procedure is open ({}); cancel it first, or wait for its end",
                            in_words(progress_.kind)));
        number = progress_.number + 1;
        progress_ = {};
        progress_.state = ProcedureState::kCollecting;
        progress_.number = number;
        progress_.kind = request.kind;
        progress_.report = (*work)->report();
        progress_.message = "add observations, then solve";
        work_ = *std::move(work);
        note_ = request.note;
        last_use_ = Clock::now();
        idle_timeout_ = idle_timeout.count() == 0 ? options_.idle_timeout : idle_timeout;
    }
    notify();
    return number;
}

absl::Status CalibrationProcedure::check_collecting() const {
    if (closed_) return absl::UnavailableError("the daemon is stopping; nothing is calibrated");
    if (!progress_.open()) return absl::FailedPreconditionError("no procedure is open; start one first");
    if (progress_.state == ProcedureState::kReading)
        return absl::FailedPreconditionError("the procedure reads files; wait for that, or stop it");
    if (progress_.state == ProcedureState::kSolving)
        return absl::FailedPreconditionError("the procedure is being solved; wait for that, or stop it");
    return absl::OkStatus();
}

absl::Status CalibrationProcedure::collect_live(LiveStep step) {
    const auto full =
        absl::ResourceExhaustedError("the maximum number of observations is stored; solve, or start again");
    std::shared_ptr<ImageMailbox> box;  // released without the mutex
    if (step != LiveStep::kPause)
        box = subscribe_([this] {
            ready_ = true;
            changed_.notify_all();
        });
    {
        const std::scoped_lock lock(mutex_);
        if (absl::Status status = check_collecting(); !status.ok()) return status;
        last_use_ = Clock::now();
        if (absl::Status status = work_->check_live_step(step); !status.ok()) return status;
        if (step == LiveStep::kMovingTarget && progress_.report.needs_empty_scene)
            return absl::FailedPreconditionError(
                "the wand is detected against the background; capture the empty scene first");
        if (step != LiveStep::kPause && progress_.report.full) return full;
        progress_.live_step = step;
        progress_.message = step == LiveStep::kPause ? "paused" : "observing the running capture";
        std::swap(box, box_);
        last_frame_set_ = Clock::now();
    }
    changed_.notify_all();
    notify();
    return absl::OkStatus();
}

absl::Status CalibrationProcedure::read(ProcedureFiles files) {
    std::shared_ptr<ProcedureWork> work;
    {
        const std::scoped_lock lock(mutex_);
        if (absl::Status status = check_collecting(); !status.ok()) return status;
        last_use_ = Clock::now();
        if (progress_.report.full)
            return absl::ResourceExhaustedError(
                "the maximum number of observations is stored; solve, or start again");
        work = work_;
    }
    if (absl::Status status = work->check_files(files); !status.ok()) return status;
    std::shared_ptr<ImageMailbox> box;
    {
        const std::scoped_lock lock(mutex_);
        if (absl::Status status = check_collecting(); !status.ok()) return status;
        if (work != work_)
            return absl::FailedPreconditionError("the procedure ended meanwhile; start another one");
        files_ = std::move(files);
        box = begin(Job::kRead, ProcedureState::kReading, "reading files");
    }
    changed_.notify_all();
    notify();
    return absl::OkStatus();
}

absl::Status CalibrationProcedure::solve() {
    std::shared_ptr<ImageMailbox> box;
    {
        const std::scoped_lock lock(mutex_);
        if (absl::Status status = check_collecting(); !status.ok()) return status;
        last_use_ = Clock::now();
        box = begin(Job::kSolve, ProcedureState::kSolving, "solving");
    }
    changed_.notify_all();
    notify();
    return absl::OkStatus();
}

absl::Status CalibrationProcedure::cancel(bool keep_observations) {
    std::shared_ptr<ImageMailbox> box;
    {
        const std::scoped_lock lock(mutex_);
        if (!progress_.open())
            return absl::FailedPreconditionError("no procedure is open; there is nothing to cancel");
        if (keep_observations && progress_.state == ProcedureState::kCollecting)
            return absl::FailedPreconditionError(
                "nothing to stop: the procedure neither reads nor solves; cancel it instead");
        last_use_ = Clock::now();
        if (keep_observations) {
            stop_job_ = true;  // the worker notifies when it has stopped
        } else {
            box = end(ProcedureState::kCancelled, "cancelled by an operator");
        }
    }
    changed_.notify_all();
    notify();
    return absl::OkStatus();
}

std::shared_ptr<ImageMailbox> CalibrationProcedure::begin(Job job, ProcedureState state,
                                                          std::string message) {
    job_ = job;
    stop_job_ = false;
    progress_.state = state;
    progress_.live_step = LiveStep::kPause;
    progress_.progress = 0;
    progress_.message = std::move(message);
    return std::move(box_);
}

std::shared_ptr<ImageMailbox> CalibrationProcedure::end(ProcedureState state, std::string message) {
    progress_.state = state;
    progress_.message = std::move(message);
    progress_.live_step = LiveStep::kPause;
    progress_.report.hints.clear();
    work_.reset();
    job_ = Job::kNone;
    stop_job_ = true;
    return std::move(box_);
}

bool CalibrationProcedure::timed_out() {
    const auto now = Clock::now();
    if (watched_()) last_use_ = now;
    return now - last_use_ > idle_timeout_;
}

// The worker's thread. The procedure may end and another one start while it works: `number` identifies it.
void CalibrationProcedure::run() {
    lower_this_threads_priority();     // the capture comes first
    oneapi::tbb::task_arena alone(1);  // none of the pipeline's workers
    std::unique_lock lock(mutex_);
    while (!closed_) {
        if (work_ && timed_out()) {
            auto box = end(ProcedureState::kCancelled,
                           fmt::format("ended: not watched or called for {:.0f} s", seconds(idle_timeout_)));
            lock.unlock();
            box.reset();
            notify();
            lock.lock();
            continue;
        }
        const Job job = std::exchange(job_, Job::kNone);
        if (job != Job::kNone) {
            const std::shared_ptr<ProcedureWork> work = work_;
            const std::uint64_t number = progress_.number;
            const ProcedureFiles files = std::exchange(files_, {});
            const std::string note = note_;
            lock.unlock();
            alone.execute([&] {
                guarded(number, [&] {
                    job == Job::kRead ? read_files(number, *work, files)
                                      : solve_observed(number, *work, note);
                });
            });
            lock.lock();
            continue;
        }
        if (box_ && ready_) {
            const std::uint64_t number = progress_.number;
            lock.unlock();
            alone.execute([&] { guarded(number, [&] { process_latest(); }); });
            lock.lock();
            continue;
        }
        if (box_ && Clock::now() - last_frame_set_ > options_.frame_set_timeout) {
            last_frame_set_ = Clock::now();
            progress_.message = fmt::format("no frame set for {:.0f} s: check whether the capture runs",
                                            seconds(options_.frame_set_timeout));
            lock.unlock();
            notify();
            lock.lock();
            continue;
        }
        changed_.wait_for(lock, kTick);
    }
}

// OpenCV, Ceres and the allocator may throw: the procedure fails, the daemon continues.
void CalibrationProcedure::guarded(std::uint64_t number, const std::function<void()>& act) {
    std::string why;
    try {
        return act();
    } catch (const std::exception& error) {
        why = error.what();
    }
    std::shared_ptr<ImageMailbox> box;
    {
        const std::scoped_lock lock(mutex_);
        if (progress_.number != number || !progress_.open()) return;
        box = end(ProcedureState::kFailed, "unexpected error: " + one_line(why));
    }
    box.reset();
    notify();
}

SolveProgress CalibrationProcedure::progress_of(std::uint64_t number) {
    return [this, number, notified = Clock::time_point()](double fraction, const std::string& what) mutable {
        {
            const std::scoped_lock lock(mutex_);
            if (closed_ || progress_.number != number || stop_job_) return false;
            if (timed_out()) return false;
            progress_.progress = fraction;
            progress_.message = what;
            if (Clock::now() - notified < kTick) return true;
            notified = Clock::now();
        }
        notify();
        return true;
    };
}

void CalibrationProcedure::read_files(std::uint64_t number, ProcedureWork& work,
                                      const ProcedureFiles& files) {
    const absl::Status status = work.read(files, progress_of(number));
    ProcedureReport report = work.report();
    {
        const std::scoped_lock lock(mutex_);
        if (progress_.number != number || !progress_.open()) return;
        progress_.state = ProcedureState::kCollecting;
        progress_.progress = 0;
        progress_.report = std::move(report);
        progress_.message = status.ok() ? kFilesReadMessage
                            : absl::IsCancelled(status)
                                ? "reading was stopped; nothing was added"
                                : "the files were not added: " + std::string(status.message());
    }
    notify();
}

void CalibrationProcedure::solve_observed(std::uint64_t number, ProcedureWork& work,
                                          const std::string& note) {
    const auto solved = work.solve(progress_of(number));
    bool overtaken = false;
    {
        const std::scoped_lock lock(mutex_);
        overtaken = closed_ || progress_.number != number || !progress_.open();
    }
    if (overtaken) return;
    const absl::StatusOr<std::string> id = solved.ok() ? store_(*solved, note) : solved.status();
    {
        const std::scoped_lock lock(mutex_);
        if (progress_.number != number || !progress_.open()) return;
        if (id.ok()) {
            end(ProcedureState::kSolved, fmt::format("solved: {}, {}", *id, to_text(solved->verdict())));
            progress_.progress = 1;
            progress_.calibration_id = *id;
            progress_.verdict = solved->verdict();
        } else if (absl::IsInternal(id.status())) {
            end(ProcedureState::kFailed, std::string(id.status().message()));
        } else {  // more observations, or room in the store, may help
            progress_.state = ProcedureState::kCollecting;
            progress_.progress = 0;
            progress_.message = absl::IsCancelled(id.status())
                                    ? "solving was stopped; the observations are kept"
                                    : "not solved: " + std::string(id.status().message());
        }
    }
    notify();
}

void CalibrationProcedure::process_latest() {
    std::shared_ptr<ImageMailbox> box;
    std::shared_ptr<ProcedureWork> work;
    LiveStep step = LiveStep::kPause;
    std::uint64_t number = 0;
    {
        const std::scoped_lock lock(mutex_);
        box = box_, work = work_, step = progress_.live_step, number = progress_.number;
    }
    ready_ = false;
    if (!box || !work) return;
    auto taken = box->take();
    if (!taken || !taken->message->result) return;
    if (taken->message->result->frame_set.recorded_frame) return;  // a replay has other cameras
    const bool over = work->observe(*taken->message->result, step);
    const std::uint64_t skipped = taken->missed;
    taken.reset();  // releases its images first
    ProcedureReport report = work->report();
    std::shared_ptr<ImageMailbox> done;
    {
        const std::scoped_lock lock(mutex_);
        if (progress_.number != number || !progress_.open()) return;
        progress_.report = std::move(report);
        progress_.skipped_frame_set_count += skipped;
        last_frame_set_ = Clock::now();
        if (box_ == box) {  // no other step was requested meanwhile
            progress_.message = "observing the running capture";
            if (over || progress_.report.full) {
                progress_.live_step = LiveStep::kPause;
                progress_.message =
                    over ? "captured; continue" : "the maximum number of observations is stored: solve";
                done = std::move(box_);
            }
        }
    }
    done.reset();
    notify();
}

}  // namespace kinevox
