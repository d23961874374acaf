#include "server/pipeline/runner.h"

#include <fmt/format.h>
#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>

#include "server/pipeline/utc_clock.h"

namespace kinevox {
namespace {

double ms_since(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

// As debuggers and `top -H` show it.
void name_thread([[maybe_unused]] std::thread& thread, [[maybe_unused]] const char* name) {
#ifdef __linux__
    pthread_setname_np(thread.native_handle(), name);
#endif
}

}  // namespace

bool is_active(RunState state) {
    return state == RunState::kStarting || state == RunState::kRunning || state == RunState::kLearning;
}

Runner::Runner(std::unique_ptr<FrameSource> source, OpenSource reopen, std::unique_ptr<Pipeline> pipeline,
               StreamHub& hub)
    : hub_(hub) {
    feed_.reopen = std::move(reopen);
    feed_.pipeline = std::move(pipeline);
    feed_.fps = source->fps();
    feed_.own_cameras = feed_.cameras = source->cameras();
    feed_.source = std::move(source);
}

Runner::~Runner() {
    abort();
    join_threads();
    finish_learning(absl::AbortedError("the capture was stopped before the background was learned"));
}

std::shared_ptr<FrameSource> Runner::source() const {
    const std::scoped_lock lock(mutex_);
    return feed_.source;
}

double Runner::source_fps() const {
    const std::scoped_lock lock(mutex_);
    return feed_.fps;
}

absl::StatusOr<Feed> Runner::exchange(Feed feed) {
    if (is_active(state().state)) return absl::FailedPreconditionError("the capture runs; stop it first");
    join_threads();  // of a run that ended by itself
    const std::scoped_lock lock(mutex_);
    if (aborted_) return absl::UnavailableError("the daemon is stopping");
    return std::exchange(feed_, std::move(feed));
}

std::vector<CameraLink> Runner::camera_links() const {
    const auto running = source();
    return running ? running->camera_links() : std::vector<CameraLink>{};
}

std::vector<Camera> Runner::cameras() const {
    const std::scoped_lock lock(mutex_);
    return feed_.cameras;
}

bool Runner::set_cameras(std::vector<Camera> cameras) {
    const bool active = is_active(state().state);
    {
        const std::scoped_lock lock(mutex_);
        feed_.next_cameras.reset();
        if (cameras == feed_.cameras) return true;
        feed_.next_cameras = std::move(cameras);
    }
    if (active) return false;
    join_threads();  // of a run that ended by itself
    take_cameras();
    return true;
}

// While nothing runs.
void Runner::take_cameras() {
    std::vector<Camera> cameras;
    {
        const std::scoped_lock lock(mutex_);
        if (!feed_.next_cameras) return;
        cameras = feed_.cameras = *std::exchange(feed_.next_cameras, std::nullopt);
    }
    feed_.pipeline->set_cameras(cameras);
    if (on_cameras_) on_cameras_(cameras);
}

absl::Status Runner::start() {
    if (is_active(state().state))
        return absl::FailedPreconditionError("the capture runs already; stop it first to start it anew");
    join_threads();  // of a run that ended by itself
    set_state(RunState::kStarting);
    take_cameras();
    absl::Status status = open_source();
    if (status.ok()) {
        const bool learned = [&] {
            const std::scoped_lock lock(mutex_);
            return feed_.background_learned;
        }();
        if (!learned) status = learn_from_clip();
    }
    if (!status.ok()) {
        set_state(RunState::kFailed, std::string(status.message()));
        tell(EventKind::kError, std::string(status.message()));
        return status;
    }
    feed_.pipeline->reset_track();
    statistics_.reset();
    utc_minus_capture_ns_.reset();
    source()->set_on_camera_event([this](const CameraEvent& event) { tell(event); });
    live_ = false;
    fetched_.open();
    reconstructed_.open();
    set_state(RunState::kRunning);
    tell(EventKind::kStarted, "capture started");
    fetch_thread_ = std::thread([this] { fetch_loop(); });
    name_thread(fetch_thread_, "fetching");
    reconstruct_thread_ = std::thread([this] { reconstruct_loop(); });
    name_thread(reconstruct_thread_, "reconstructing");
    pose_thread_ = std::thread([this] { pose_loop(); });
    name_thread(pose_thread_, "posing");
    return absl::OkStatus();
}

absl::Status Runner::stop() {
    if (!is_active(state().state))
        return absl::FailedPreconditionError("the capture does not run; start it first");
    if (const auto running = source()) running->stop();
    join_threads();
    finish_learning(absl::AbortedError("the capture was stopped before the background was learned"));
    {
        const std::scoped_lock lock(mutex_);
        feed_.source.reset();
    }
    if (feed_.taps.on_end) feed_.taps.on_end();
    if (state().state != RunState::kFailed) set_state(RunState::kStopped);
    tell(EventKind::kStopped, "capture stopped");
    return absl::OkStatus();
}

void Runner::abort() {
    std::shared_ptr<FrameSource> running;
    {
        const std::scoped_lock lock(mutex_);
        aborted_ = true;
        running = feed_.source;
    }
    if (running) running->stop();
    close_handovers();
    finish_learning(absl::UnavailableError("the daemon is stopping; the background was not learned"));
}

void Runner::join_threads() {
    close_handovers();
    for (std::thread* thread : {&fetch_thread_, &reconstruct_thread_, &pose_thread_})
        if (thread->joinable()) thread->join();
}

absl::Status Runner::open_source() {
    {
        const std::scoped_lock lock(mutex_);
        if (aborted_) return absl::UnavailableError("the daemon is stopping");
        if (feed_.source) return absl::OkStatus();
    }
    auto opened = feed_.reopen();
    if (!opened.ok()) return opened.status();
    if ((*opened)->cameras() != feed_.own_cameras)
        return absl::FailedPreconditionError(
            "the source's cameras or their calibration have changed since the "
            "daemon was started; restart the daemon");
    const std::scoped_lock lock(mutex_);
    if (aborted_) return absl::UnavailableError("the daemon is stopping");
    feed_.source = std::move(*opened);
    return absl::OkStatus();
}

absl::Status Runner::learn_from_clip() {
    const auto pictures = source()->background();
    if (!pictures.ok()) return pictures.status();
    const bool complete = !pictures->empty() &&
                          std::ranges::none_of(*pictures, [](const auto& camera) { return camera.empty(); });
    if (!complete) return absl::OkStatus();  // an operator will let it learn from live frames
    if (const absl::Status learned = feed_.pipeline->learn_background(*pictures); !learned.ok())
        return learned;
    const std::size_t count = pictures->front().size();
    if (feed_.taps.on_background)
        feed_.taps.on_background(
            std::make_shared<const std::vector<std::vector<Picture>>>(*std::move(pictures)));
    {
        const std::scoped_lock lock(mutex_);
        feed_.background_learned = true;
    }
    tell(EventKind::kBackgroundLearned,
         fmt::format("background learned from the source's own {} pictures a camera", count));
    return absl::OkStatus();
}

void Runner::learn_background(int frames, std::function<void(absl::Status)> done) {
    const RunState now = state().state;
    if (frames < 0 || frames > kMaxLearningFrames)
        return done(absl::InvalidArgumentError(fmt::format(
            "frames is {}; learning takes 1 to {} live frame sets, or 0 for the source's own clip", frames,
            kMaxLearningFrames)));
    if (frames == 0) {
        if (is_active(now))
            return done(
                absl::FailedPreconditionError("the capture runs; stop it to learn from the source's own "
                                              "clip, or give a number of live frame sets"));
        absl::Status status = open_source();
        if (status.ok()) {
            {
                const std::scoped_lock lock(mutex_);
                feed_.background_learned = false;
            }
            status = learn_from_clip();
        }
        const bool learned = [&] {
            const std::scoped_lock lock(mutex_);
            return feed_.background_learned;
        }();
        if (status.ok() && !learned)
            status = absl::FailedPreconditionError(
                "the source has no clip of the empty scene; start the capture, "
                "clear the scene and give a number of live frame sets");
        return done(status);
    }
    if (now != RunState::kRunning)
        return done(absl::FailedPreconditionError(
            now == RunState::kLearning ? "a background is being learned already; wait for it"
                                       : "the capture does not run; start it to learn from live frames"));
    std::int64_t set_bytes = 0;
    for (const Camera& camera : feed_.own_cameras)
        set_bytes += std::int64_t{3} * camera.width * camera.height;
    if (set_bytes * frames > kMaxLearningBytes)
        return done(absl::InvalidArgumentError(fmt::format(
            "{} frame sets of these cameras take {} MB while they are collected; ask for {} at most", frames,
            set_bytes * frames >> 20, std::max<std::int64_t>(1, kMaxLearningBytes / set_bytes))));
    {
        const std::scoped_lock lock(mutex_);
        // The recording may have ended between the look at the state and here.
        if (state_.state == RunState::kRunning && !aborted_) {
            state_ = {RunState::kLearning, fmt::format("learning the background from {} frame sets", frames)};
            learning_ =
                Learning{frames, 0, std::chrono::steady_clock::now(),
                         std::vector<std::vector<Picture>>(feed_.own_cameras.size()), std::move(done)};
            return;
        }
    }
    done(absl::FailedPreconditionError("the capture has just ended; start it to learn from live frames"));
}

void Runner::fetch_loop() {
    const std::shared_ptr<FrameSource> source = this->source();
    // Of what is live, the newest is of use. Cameras do not wait: what nobody took is replaced. The studio
    // would draw in vain what nobody takes.
    const bool cameras = !source->camera_links().empty();
    live_ = cameras;
    for (bool last = false; !last;) {
        if (live_ && !cameras && !fetched_.wait_until_empty()) return;
        const auto start = std::chrono::steady_clock::now();
        Fetched fetched{source->next(), 0};
        fetched.waited_ms = ms_since(start);
        last = !fetched.frame_set.ok();
        if (!last) {
            live_ = cameras || is_live(fetched.frame_set->capture_time_ns);
            if (feed_.taps.on_frame_set) feed_.taps.on_frame_set(*fetched.frame_set);
        }
        const bool handed_on =
            cameras && !last ? fetched_.replace(std::move(fetched)) : fetched_.push(std::move(fetched));
        if (!handed_on) return;
    }
}

void Runner::reconstruct_loop() {
    // Of a live source nothing is begun that would wait for the pose of another: it would be old by then.
    while (!live_ || reconstructed_.wait_until_empty()) {
        std::optional<Fetched> fetched = next_fetched();
        if (!fetched) return;
        reconstructing_.take();
        absl::StatusOr<std::unique_ptr<Reconstruction>> reconstruction = reconstruct(*std::move(fetched));
        reconstructing_
            .put_down();  // one that it cannot hand on is held up by the posing thread, which has its own
        if (reconstruction.ok() && *reconstruction == nullptr) continue;
        const bool last = !reconstruction.ok();
        if (!reconstructed_.push(std::move(reconstruction)) || last) return;
    }
}

// Empty once it is over.
std::optional<Runner::Fetched> Runner::next_fetched() {
    while (!fetched_.wait_for_one(max_silence_ / 4)) give_up_silent_learning();
    return fetched_.pop();
}

absl::StatusOr<std::unique_ptr<Reconstruction>> Runner::reconstruct(Fetched fetched) {
    if (!fetched.frame_set.ok()) return fetched.frame_set.status();
    FrameSet frame_set = *std::move(fetched.frame_set);
    if (frame_set.decode_ms == 0) frame_set.decode_ms = fetched.waited_ms;
    bool learning = false, learned = false;
    {
        const std::scoped_lock lock(mutex_);
        learning = learning_.has_value();
        learned = feed_.background_learned;
    }
    if (learning) {
        collect(frame_set);
        return nullptr;
    }
    if (learned) return feed_.pipeline->reconstruct(std::move(frame_set));

    // Pictures alone, so that an operator sees whether the scene is empty.
    auto pictures_only = std::make_unique<Reconstruction>();
    pictures_only->arrived = std::chrono::steady_clock::now();
    pictures_only->result = std::make_shared<FrameResult>();
    pictures_only->result->sequence = frame_set.sequence;
    pictures_only->result->capture_time_ns = frame_set.capture_time_ns;
    pictures_only->result->times.decode_ms = frame_set.decode_ms;
    pictures_only->result->frame_set = std::move(frame_set);
    return pictures_only;
}

void Runner::pose_loop() {
    while (auto reconstruction = reconstructed_.pop()) {
        if (!reconstruction->ok()) return end(reconstruction->status());
        posing_.take();
        const absl::StatusOr<FrameResultPtr> result = feed_.pipeline->pose(**std::move(reconstruction));
        if (result.ok()) publish(*result);
        posing_.put_down();
        if (!result.ok()) return end(result.status());
    }
}

std::chrono::nanoseconds Runner::max_in_hand(InHand::Clock::time_point now) const {
    return std::max(reconstructing_.held(now), posing_.held(now));
}

void Runner::publish(const FrameResultPtr& result) {
    if (!utc_minus_capture_ns_) {
        utc_minus_capture_ns_ = utc_minus_capture_ns(result->capture_time_ns);
        clock_steps_ = {};
    } else if (const std::int64_t step_ns = clock_steps_.step_ns(); step_ns != 0) {
        *utc_minus_capture_ns_ += step_ns;
        tell(EventKind::kError,
             fmt::format("the machine's clock was set {} by {:.1f} s; the times of what is streamed follow "
                         "it, those of a "
                         "recording that has begun go on evenly",
                         step_ns > 0 ? "forward" : "back", 1e-9 * static_cast<double>(std::abs(step_ns))),
             result->sequence);
    }
    if (after_result_) after_result_(*result);
    statistics_.add(result->sequence, result->times);
    hub_.publish(result, *utc_minus_capture_ns_);
}

// The last that a run's threads do, unless stop() or abort() were first.
void Runner::end(const absl::Status& why) {
    if (absl::IsCancelled(why)) return;
    const bool over = absl::IsOutOfRange(why);
    finish_learning(absl::AbortedError(over ? "the recording ended before the background was learned"
                                            : "the capture failed before the background was learned"));
    const std::string message = over ? "the recording is over" : std::string(why.message());
    set_state(over ? RunState::kEnded : RunState::kFailed, message);
    tell(over ? EventKind::kSourceEnded : EventKind::kError, message,
         over ? statistics_.figures().newest_sequence : 0);
    close_handovers();  // lets the other threads go
    {
        const std::scoped_lock lock(mutex_);
        if (feed_.source) feed_.source->stop();
        feed_.source.reset();
    }
    if (feed_.taps.on_end) feed_.taps.on_end();
}

void Runner::collect(const FrameSet& frame_set) {
    std::optional<Learning> complete;
    {
        const std::scoped_lock lock(mutex_);
        if (!learning_) return;  // aborted meanwhile
        Learning& learning = *learning_;
        ++learning.seen;
        learning.newest_at = std::chrono::steady_clock::now();
        const bool usable = frame_set.pictures.size() == feed_.own_cameras.size() &&
                            std::ranges::none_of(frame_set.pictures, &Picture::empty);
        if (usable)
            for (std::size_t c = 0; c < feed_.own_cameras.size(); ++c)
                learning.pictures[c].push_back(frame_set.pictures[c]);
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
        status = feed_.pipeline->learn_background(complete->pictures);
    if (status.ok()) feed_.pipeline->reset_track();
    if (status.ok() && feed_.taps.on_background)
        feed_.taps.on_background(
            std::make_shared<const std::vector<std::vector<Picture>>>(std::move(complete->pictures)));
    {
        const std::scoped_lock lock(mutex_);
        if (status.ok()) feed_.background_learned = true;
        if (state_.state == RunState::kLearning) state_ = {RunState::kRunning, {}};
    }
    if (status.ok())
        tell(EventKind::kBackgroundLearned,
             fmt::format("background learned from {} live frame sets", complete->wanted), frame_set.sequence);
    complete->done(status);
}

// Its caller would wait for cameras that nothing triggers until his patience is over, and not know why.
void Runner::give_up_silent_learning() {
    std::optional<Learning> silent;
    {
        const std::scoped_lock lock(mutex_);
        if (!learning_ || std::chrono::steady_clock::now() - learning_->newest_at < max_silence_) return;
        silent.swap(learning_);
        state_ = {RunState::kRunning, {}};
    }
    silent->done(absl::FailedPreconditionError(
        fmt::format("no frame set came for {:g} s, after {} of the {} to learn from; see that the cameras "
                    "deliver pictures",
                    std::chrono::duration<double>(max_silence_).count(), silent->seen, silent->wanted)));
}

void Runner::finish_learning(absl::Status status) {
    std::optional<Learning> pending;
    {
        const std::scoped_lock lock(mutex_);
        pending.swap(learning_);
    }
    if (pending) pending->done(std::move(status));
}

void Runner::close_handovers() {
    fetched_.close();
    reconstructed_.close();
}

Runner::State Runner::state() const {
    const std::scoped_lock lock(mutex_);
    return state_;
}

void Runner::set_state(RunState state, std::string message) {
    const std::scoped_lock lock(mutex_);
    state_ = {state, std::move(message)};
}

void Runner::tell(const CameraEvent& event) {
    const auto kind = [&] {
        switch (event.kind) {
            case CameraEvent::Kind::kLost:
                return EventKind::kCameraLost;
            case CameraEvent::Kind::kRejoined:
                return EventKind::kCameraRejoined;
            case CameraEvent::Kind::kLosses:
                break;
        }
        return EventKind::kCameraLosses;
    }();
    hub_.publish_event({kind, 0, 0, feed_.own_cameras.at(event.camera).name, event.message}, utc_now_ns());
}

void Runner::tell(EventKind kind, std::string message, std::uint64_t sequence) {
    hub_.publish_event({kind, sequence, 0, {}, std::move(message)}, utc_now_ns());
}

}  // namespace kinevox
