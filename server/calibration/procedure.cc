#include "server/calibration/procedure.h"

#include <fmt/format.h>
#include <oneapi/tbb/task_arena.h>

#include <exception>
#include <utility>

#include "common/background_priority.h"
#include "common/one_line.h"

namespace kinevox {
namespace {

constexpr std::chrono::milliseconds kTick{
    100};  // how late an end by neglect, or a frame set, is noticed at most

const char* in_words(ProcedureKind kind) {
    switch (kind) {
        case ProcedureKind::kIntrinsics:
            return "lenses from a board";
        case ProcedureKind::kExtrinsicsBoard:
            return "places from a board";
        case ProcedureKind::kExtrinsicsWand:
            return "places from a wand";
        case ProcedureKind::kRefinePerson:
            return "places from a person";
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
    std::shared_ptr<PictureMailbox> box;
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

void CalibrationProcedure::tell() {
    const std::scoped_lock telling(telling_);
    on_progress_(progress());
}

absl::StatusOr<std::uint64_t> CalibrationProcedure::start(const ProcedureRequest& request,
                                                          const std::vector<Camera>& cameras,
                                                          std::chrono::milliseconds abandon_after) {
    if (abandon_after.count() < 0 || abandon_after > options_.max_abandon_after)
        return absl::InvalidArgumentError(
            fmt::format("abandon_after_ms is {}; 1 to {} is allowed, or 0 for {}", abandon_after.count(),
                        options_.max_abandon_after.count(), options_.abandon_after.count()));
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
        abandon_after_ = abandon_after.count() == 0 ? options_.abandon_after : abandon_after;
    }
    tell();
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

absl::Status CalibrationProcedure::take(Taking what) {
    const auto full = absl::ResourceExhaustedError("as much is observed as is kept; solve, or begin anew");
    std::shared_ptr<PictureMailbox> box;  // let go without the mutex
    if (what != Taking::kNothing)
        box = subscribe_([this] {
            ready_ = true;
            changed_.notify_all();
        });
    {
        const std::scoped_lock lock(mutex_);
        if (absl::Status status = check_collecting(); !status.ok()) return status;
        last_use_ = Clock::now();
        if (absl::Status status = work_->check_taking(what); !status.ok()) return status;
        if (what == Taking::kMoving && progress_.report.needs_empty_scene)
            return absl::FailedPreconditionError(
                "the wand is found by what was not there before; take a picture of the empty scene first");
        if (what != Taking::kNothing && progress_.report.full) return full;
        progress_.taking = what;
        progress_.message = what == Taking::kNothing ? "paused" : "looking at the running capture";
        std::swap(box, box_);
        last_frame_set_ = Clock::now();
    }
    changed_.notify_all();
    tell();
    return absl::OkStatus();
}

absl::Status CalibrationProcedure::read(ProcedureFiles files) {
    std::shared_ptr<ProcedureWork> work;
    {
        const std::scoped_lock lock(mutex_);
        if (absl::Status status = check_collecting(); !status.ok()) return status;
        last_use_ = Clock::now();
        if (progress_.report.full)
            return absl::ResourceExhaustedError("as much is observed as is kept; solve, or begin anew");
        work = work_;
    }
    if (absl::Status status = work->check_files(files); !status.ok()) return status;
    std::shared_ptr<PictureMailbox> box;
    {
        const std::scoped_lock lock(mutex_);
        if (absl::Status status = check_collecting(); !status.ok()) return status;
        if (work != work_)
            return absl::FailedPreconditionError("the procedure was ended meanwhile; start one anew");
        files_ = std::move(files);
        box = begin(Job::kRead, ProcedureState::kReading, "reading files");
    }
    changed_.notify_all();
    tell();
    return absl::OkStatus();
}

absl::Status CalibrationProcedure::solve() {
    std::shared_ptr<PictureMailbox> box;
    {
        const std::scoped_lock lock(mutex_);
        if (absl::Status status = check_collecting(); !status.ok()) return status;
        last_use_ = Clock::now();
        box = begin(Job::kSolve, ProcedureState::kSolving, "solving");
    }
    changed_.notify_all();
    tell();
    return absl::OkStatus();
}

absl::Status CalibrationProcedure::cancel(bool keep_observations) {
    std::shared_ptr<PictureMailbox> box;
    {
        const std::scoped_lock lock(mutex_);
        if (!progress_.open())
            return absl::FailedPreconditionError("no procedure is open; there is nothing to cancel");
        if (keep_observations && progress_.state == ProcedureState::kCollecting)
            return absl::FailedPreconditionError(
                "the procedure neither reads nor solves; there is nothing to stop but the procedure itself");
        last_use_ = Clock::now();
        if (keep_observations) {
            stop_job_ = true;  // the worker tells when it has stopped
        } else {
            box = end(ProcedureState::kCancelled, "cancelled by an operator");
        }
    }
    changed_.notify_all();
    tell();
    return absl::OkStatus();
}

std::shared_ptr<PictureMailbox> CalibrationProcedure::begin(Job job, ProcedureState state,
                                                            std::string message) {
    job_ = job;
    stop_job_ = false;
    progress_.state = state;
    progress_.taking = Taking::kNothing;
    progress_.part = 0;
    progress_.message = std::move(message);
    return std::move(box_);
}

std::shared_ptr<PictureMailbox> CalibrationProcedure::end(ProcedureState state, std::string message) {
    progress_.state = state;
    progress_.message = std::move(message);
    progress_.taking = Taking::kNothing;
    progress_.report.hints.clear();
    work_.reset();
    job_ = Job::kNone;
    stop_job_ = true;
    return std::move(box_);
}

bool CalibrationProcedure::abandoned() {
    const auto now = Clock::now();
    if (watched_()) last_use_ = now;
    return now - last_use_ > abandon_after_;
}

// The worker's. Whatever it does may be overtaken by the procedure's end and another one's start: `number`
// tells.
void CalibrationProcedure::run() {
    lower_this_threads_priority();     // the capture comes first
    oneapi::tbb::task_arena alone(1);  // none of the pipeline's workers
    std::unique_lock lock(mutex_);
    while (!closed_) {
        if (work_ && abandoned()) {
            auto box = end(ProcedureState::kCancelled,
                           fmt::format("ended by itself: nobody watched it or called for it for {:.0f} s",
                                       seconds(abandon_after_)));
            lock.unlock();
            box.reset();
            tell();
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
            alone.execute([&] { guarded(number, [&] { look_at_newest(); }); });
            lock.lock();
            continue;
        }
        if (box_ && Clock::now() - last_frame_set_ > options_.silence) {
            last_frame_set_ = Clock::now();
            progress_.message = fmt::format("no frame set has come for {:.0f} s: does the capture run?",
                                            seconds(options_.silence));
            lock.unlock();
            tell();
            lock.lock();
            continue;
        }
        changed_.wait_for(lock, kTick);
    }
}

// OpenCV, Ceres and the allocator throw what nobody expects: the procedure fails, the daemon goes on.
void CalibrationProcedure::guarded(std::uint64_t number, const std::function<void()>& act) {
    std::string why;
    try {
        return act();
    } catch (const std::exception& error) {
        why = error.what();
    }
    std::shared_ptr<PictureMailbox> box;
    {
        const std::scoped_lock lock(mutex_);
        if (progress_.number != number || !progress_.open()) return;
        box = end(ProcedureState::kFailed, "failed on an error nobody expected: " + one_line(why));
    }
    box.reset();
    tell();
}

SolveProgress CalibrationProcedure::progress_of(std::uint64_t number) {
    return [this, number, told = Clock::time_point()](double part, const std::string& what) mutable {
        {
            const std::scoped_lock lock(mutex_);
            if (closed_ || progress_.number != number || stop_job_) return false;
            if (abandoned()) return false;
            progress_.part = part;
            progress_.message = what;
            if (Clock::now() - told < kTick) return true;
            told = Clock::now();
        }
        tell();
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
        progress_.part = 0;
        progress_.report = std::move(report);
        progress_.message = status.ok() ? "the files are read"
                            : absl::IsCancelled(status)
                                ? "reading was stopped; nothing of these files was added"
                                : "the files were not added: " + std::string(status.message());
    }
    tell();
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
            progress_.part = 1;
            progress_.calibration_id = *id;
            progress_.verdict = solved->verdict();
        } else if (absl::IsInternal(id.status())) {
            end(ProcedureState::kFailed, std::string(id.status().message()));
        } else {  // more observations, or room in the store, may help
            progress_.state = ProcedureState::kCollecting;
            progress_.part = 0;
            progress_.message = absl::IsCancelled(id.status())
                                    ? "solving was stopped; the observations are kept"
                                    : "not solved: " + std::string(id.status().message());
        }
    }
    tell();
}

void CalibrationProcedure::look_at_newest() {
    std::shared_ptr<PictureMailbox> box;
    std::shared_ptr<ProcedureWork> work;
    Taking what = Taking::kNothing;
    std::uint64_t number = 0;
    {
        const std::scoped_lock lock(mutex_);
        box = box_, work = work_, what = progress_.taking, number = progress_.number;
    }
    ready_ = false;
    if (!box || !work) return;
    auto taken = box->take();
    if (!taken || !taken->message->result) return;
    if (taken->message->result->frame_set.recorded_frame) return;  // a replay's cameras are others
    const bool over = work->observe(*taken->message->result, what);
    const std::uint64_t skipped = taken->missed;
    taken.reset();  // its pictures go before anything else
    ProcedureReport report = work->report();
    std::shared_ptr<PictureMailbox> done;
    {
        const std::scoped_lock lock(mutex_);
        if (progress_.number != number || !progress_.open()) return;
        progress_.report = std::move(report);
        progress_.skipped += skipped;
        last_frame_set_ = Clock::now();
        if (box_ == box) {  // nobody has asked for something else meanwhile
            progress_.message = "looking at the running capture";
            if (over || progress_.report.full) {
                progress_.taking = Taking::kNothing;
                progress_.message = over ? "seen; go on" : "as much is observed as is kept: solve";
                done = std::move(box_);
            }
        }
    }
    done.reset();
    tell();
}

}  // namespace kinevox
