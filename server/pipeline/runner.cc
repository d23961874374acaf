#include "server/pipeline/runner.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>

#include <fmt/format.h>

#include "server/pipeline/utc_clock.h"

namespace kinevox {
namespace {

double ms_since(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

// What makes UTC of a run's capture times, from the first of them. A live source's are the steady clock's, thus near
// now; a recording's count from 0 and become the time since the run's start.
std::int64_t utc_minus_capture_ns(std::int64_t first_capture_time_ns) {
    constexpr std::int64_t kNearNs = 60'000'000'000;
    const std::int64_t steady_now_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(
                                           std::chrono::steady_clock::now().time_since_epoch()).count();
    const bool live = std::abs(steady_now_ns - first_capture_time_ns) < kNearNs;
    return utc_now_ns() - (live ? steady_now_ns : first_capture_time_ns);
}

bool is_active(RunState state) {
    return state == RunState::kStarting || state == RunState::kRunning || state == RunState::kLearning;
}

}  // namespace

Runner::Runner(std::unique_ptr<FrameSource> source, OpenSource reopen, std::unique_ptr<Pipeline> pipeline,
               StreamHub& hub)
    : reopen_(std::move(reopen)), pipeline_(std::move(pipeline)), hub_(hub), cameras_(source->cameras()),
      source_fps_(source->fps()), source_(std::move(source)) {}

Runner::~Runner() {
    abort();
    join_threads();
    finish_learning(absl::AbortedError("the capture was stopped before the background was learned"));
}

std::shared_ptr<FrameSource> Runner::source() const {
    const std::scoped_lock lock(mutex_);
    return source_;
}

absl::Status Runner::start() {
    if (is_active(state().state))
        return absl::FailedPreconditionError("the capture runs already; stop it first to start it anew");
    join_threads();   // of a run that ended by itself
    set_state(RunState::kStarting);
    absl::Status status = open_source();
    if (status.ok()) {
        const bool learned = [&] { const std::scoped_lock lock(mutex_); return background_learned_; }();
        if (!learned) status = learn_from_clip();
    }
    if (!status.ok()) {
        set_state(RunState::kFailed, std::string(status.message()));
        tell(EventKind::kError, std::string(status.message()));
        return status;
    }
    pipeline_->reset_track();
    statistics_.reset();
    utc_minus_capture_ns_.reset();
    {
        const std::scoped_lock lock(queue_mutex_);
        ready_.reset();
        queue_closed_ = false;
    }
    set_state(RunState::kRunning);
    tell(EventKind::kStarted, "capture started");
    fetch_thread_ = std::thread([this] { fetch_loop(); });
    pipeline_thread_ = std::thread([this] { pipeline_loop(); });
    return absl::OkStatus();
}

absl::Status Runner::stop() {
    if (!is_active(state().state)) return absl::FailedPreconditionError("the capture does not run; start it first");
    if (const auto running = source()) running->stop();
    join_threads();
    finish_learning(absl::AbortedError("the capture was stopped before the background was learned"));
    {
        const std::scoped_lock lock(mutex_);
        source_.reset();
    }
    if (state().state != RunState::kFailed) set_state(RunState::kStopped);
    tell(EventKind::kStopped, "capture stopped");
    return absl::OkStatus();
}

void Runner::abort() {
    std::shared_ptr<FrameSource> running;
    {
        const std::scoped_lock lock(mutex_);
        aborted_ = true;
        running = source_;
    }
    if (running) running->stop();
    close_queue();
    finish_learning(absl::UnavailableError("the daemon is stopping; the background was not learned"));
}

void Runner::join_threads() {
    close_queue();
    if (fetch_thread_.joinable()) fetch_thread_.join();
    if (pipeline_thread_.joinable()) pipeline_thread_.join();
}

absl::Status Runner::open_source() {
    {
        const std::scoped_lock lock(mutex_);
        if (aborted_) return absl::UnavailableError("the daemon is stopping");
        if (source_) return absl::OkStatus();
    }
    absl::StatusOr<std::unique_ptr<FrameSource>> opened = reopen_();
    if (!opened.ok()) return opened.status();
    if ((*opened)->cameras() != cameras_)
        return absl::FailedPreconditionError("the source's cameras or their calibration have changed since the "
                                             "daemon was started; restart the daemon");
    const std::scoped_lock lock(mutex_);
    if (aborted_) return absl::UnavailableError("the daemon is stopping");
    source_ = std::move(*opened);
    return absl::OkStatus();
}

absl::Status Runner::learn_from_clip() {
    const auto pictures = source()->background();
    if (!pictures.ok()) return pictures.status();
    const bool complete = !pictures->empty() &&
                          std::ranges::none_of(*pictures, [](const auto& camera) { return camera.empty(); });
    if (!complete) return absl::OkStatus();   // an operator will let it learn from live frames
    if (const absl::Status learned = pipeline_->learn_background(*pictures); !learned.ok()) return learned;
    {
        const std::scoped_lock lock(mutex_);
        background_learned_ = true;
    }
    tell(EventKind::kBackgroundLearned, fmt::format("background learned from the source's own {} pictures a camera",
                                                    pictures->front().size()));
    return absl::OkStatus();
}

void Runner::learn_background(int frames, std::function<void(absl::Status)> done) {
    const RunState now = state().state;
    if (frames < 0 || frames > kMaxLearningFrames)
        return done(absl::InvalidArgumentError(
            fmt::format("frames is {}; learning takes 1 to {} live frame sets, or 0 for the source's own clip", frames,
                        kMaxLearningFrames)));
    if (frames == 0) {
        if (is_active(now))
            return done(absl::FailedPreconditionError("the capture runs; stop it to learn from the source's own "
                                                      "clip, or give a number of live frame sets"));
        absl::Status status = open_source();
        if (status.ok()) {
            { const std::scoped_lock lock(mutex_); background_learned_ = false; }
            status = learn_from_clip();
        }
        const bool learned = [&] { const std::scoped_lock lock(mutex_); return background_learned_; }();
        if (status.ok() && !learned)
            status = absl::FailedPreconditionError("the source has no clip of the empty scene; start the capture, "
                                                   "clear the scene and give a number of live frame sets");
        return done(status);
    }
    if (now != RunState::kRunning)
        return done(absl::FailedPreconditionError(now == RunState::kLearning
                                                      ? "a background is being learned already; wait for it"
                                                      : "the capture does not run; start it to learn from live frames"));
    std::int64_t set_bytes = 0;
    for (const Camera& camera : cameras_) set_bytes += std::int64_t{3} * camera.width * camera.height;
    if (set_bytes * frames > kMaxLearningBytes)
        return done(absl::InvalidArgumentError(
            fmt::format("{} frame sets of these cameras take {} MB while they are collected; ask for {} at most",
                        frames, set_bytes * frames >> 20, std::max<std::int64_t>(1, kMaxLearningBytes / set_bytes))));
    {
        const std::scoped_lock lock(mutex_);
        // The recording may have ended between the look at the state and here.
        if (state_.state == RunState::kRunning && !aborted_) {
            state_ = {RunState::kLearning, fmt::format("learning the background from {} frame sets", frames)};
            learning_ = Learning{frames, 0, std::vector<std::vector<Picture>>(cameras_.size()), std::move(done)};
            return;
        }
    }
    done(absl::FailedPreconditionError("the capture has just ended; start it to learn from live frames"));
}

void Runner::fetch_loop() {
    const std::shared_ptr<FrameSource> source = this->source();
    for (bool last = false; !last;) {
        const auto start = std::chrono::steady_clock::now();
        Fetched fetched{source->next(), 0};
        fetched.waited_ms = ms_since(start);
        last = !fetched.frame_set.ok();
        if (!push(std::move(fetched))) return;
    }
}

void Runner::pipeline_loop() {
    while (std::optional<Fetched> fetched = pop()) {
        if (fetched->frame_set.ok()) {
            handle(std::move(*fetched->frame_set), fetched->waited_ms);
            if (state().state == RunState::kFailed) break;
            continue;
        }
        const absl::Status& why = fetched->frame_set.status();
        if (absl::IsOutOfRange(why)) {
            finish_learning(absl::AbortedError("the recording ended before the background was learned"));
            set_state(RunState::kEnded, "the recording is over");
            tell(EventKind::kSourceEnded, "the recording is over", statistics_.figures().newest_sequence);
        } else if (!absl::IsCancelled(why)) {
            set_state(RunState::kFailed, std::string(why.message()));
            tell(EventKind::kError, std::string(why.message()));
        }
        break;
    }
    if (const RunState ended = state().state; ended == RunState::kEnded || ended == RunState::kFailed) {
        close_queue();   // lets the fetching thread go
        finish_learning(absl::AbortedError("the capture failed before the background was learned"));
        const std::scoped_lock lock(mutex_);
        if (source_) source_->stop();
        source_.reset();
    }
}

void Runner::handle(FrameSet frame_set, double waited_ms) {
    if (!utc_minus_capture_ns_) utc_minus_capture_ns_ = utc_minus_capture_ns(frame_set.capture_time_ns);
    if (frame_set.decode_ms == 0) frame_set.decode_ms = waited_ms;
    bool learning = false, learned = false;
    {
        const std::scoped_lock lock(mutex_);
        learning = learning_.has_value();
        learned = background_learned_;
    }
    if (learning) return collect(frame_set);

    if (!learned) {   // pictures alone, so that an operator sees whether the scene is empty
        auto pictures_only = std::make_shared<FrameResult>();
        pictures_only->sequence = frame_set.sequence;
        pictures_only->capture_time_ns = frame_set.capture_time_ns;
        pictures_only->times.decode_ms = frame_set.decode_ms;
        pictures_only->frame_set = std::move(frame_set);
        statistics_.add(pictures_only->sequence, pictures_only->times);
        return hub_.publish(pictures_only, *utc_minus_capture_ns_);
    }
    const absl::StatusOr<FrameResultPtr> result = pipeline_->process(std::move(frame_set));
    if (!result.ok()) {
        set_state(RunState::kFailed, std::string(result.status().message()));
        return tell(EventKind::kError, std::string(result.status().message()));
    }
    if (after_result_) after_result_(**result);
    statistics_.add((*result)->sequence, (*result)->times);
    hub_.publish(*result, *utc_minus_capture_ns_);
}

void Runner::collect(const FrameSet& frame_set) {
    std::optional<Learning> complete;
    {
        const std::scoped_lock lock(mutex_);
        Learning& learning = *learning_;
        ++learning.seen;
        const bool usable = frame_set.pictures.size() == cameras_.size() &&
                            std::ranges::none_of(frame_set.pictures, &Picture::empty);
        if (usable)
            for (std::size_t c = 0; c < cameras_.size(); ++c) learning.pictures[c].push_back(frame_set.pictures[c]);
        const bool enough = static_cast<int>(learning.pictures.front().size()) >= learning.wanted;
        const bool hopeless = learning.seen >= 3 * learning.wanted + 30;
        if (!enough && !hopeless) return;
        complete = std::move(learning_);
        learning_.reset();
    }
    absl::Status status;
    if (static_cast<int>(complete->pictures.front().size()) < complete->wanted)
        status = absl::FailedPreconditionError(
            fmt::format("of {} frame sets only {} had a picture of every camera; see which camera is silent",
                        complete->seen, complete->pictures.front().size()));
    else
        status = pipeline_->learn_background(complete->pictures);
    if (status.ok()) pipeline_->reset_track();
    {
        const std::scoped_lock lock(mutex_);
        if (status.ok()) background_learned_ = true;
        if (state_.state == RunState::kLearning) state_ = {RunState::kRunning, {}};
    }
    if (status.ok())
        tell(EventKind::kBackgroundLearned,
             fmt::format("background learned from {} live frame sets", complete->wanted), frame_set.sequence);
    complete->done(status);
}

void Runner::finish_learning(absl::Status status) {
    std::optional<Learning> pending;
    {
        const std::scoped_lock lock(mutex_);
        pending.swap(learning_);
    }
    if (pending) pending->done(std::move(status));
}

bool Runner::push(Fetched fetched) {
    std::unique_lock lock(queue_mutex_);
    queue_changed_.wait(lock, [&] { return queue_closed_ || !ready_; });
    if (queue_closed_) return false;
    ready_ = std::move(fetched);
    queue_changed_.notify_all();
    return true;
}

std::optional<Runner::Fetched> Runner::pop() {
    std::unique_lock lock(queue_mutex_);
    queue_changed_.wait(lock, [&] { return queue_closed_ || ready_; });
    if (queue_closed_) return std::nullopt;
    std::optional<Fetched> taken;
    taken.swap(ready_);
    queue_changed_.notify_all();
    return taken;
}

void Runner::close_queue() {
    const std::scoped_lock lock(queue_mutex_);
    queue_closed_ = true;
    queue_changed_.notify_all();
}

Runner::State Runner::state() const {
    const std::scoped_lock lock(mutex_);
    return state_;
}

void Runner::set_state(RunState state, std::string message) {
    const std::scoped_lock lock(mutex_);
    state_ = {state, std::move(message)};
}

void Runner::tell(EventKind kind, std::string message, std::uint64_t sequence) {
    hub_.publish_event({kind, sequence, 0, {}, std::move(message)}, utc_now_ns());
}

}  // namespace kinevox
