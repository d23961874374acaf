#include "server/pipeline/runner.h"

#include <fmt/format.h>
#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>

#include "common/stopwatch.h"

namespace kinevox {
namespace {

// As shown by debuggers and `top -H`.
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
    setup_.reopen = std::move(reopen);
    setup_.pipeline = std::move(pipeline);
    setup_.fps = source->fps();
    setup_.own_cameras = setup_.cameras = source->cameras();
    setup_.source = std::move(source);
}

Runner::~Runner() {
    abort();
    join_threads();
    end_learning(absl::AbortedError("the capture was stopped before the background was learned"));
}

std::shared_ptr<FrameSource> Runner::source() const {
    const std::scoped_lock lock(mutex_);
    return setup_.source;
}

std::shared_ptr<SubjectControl> Runner::subject_control() const {
    const std::lock_guard lock(mutex_);
    return setup_.pipeline ? setup_.pipeline->subject_control() : nullptr;
}

double Runner::source_fps() const {
    const std::scoped_lock lock(mutex_);
    return setup_.fps;
}

absl::StatusOr<CaptureSetup> Runner::swap_setup(CaptureSetup setup) {
    if (is_active(state().state))
        return absl::FailedPreconditionError("the capture is running; stop it first");
    join_threads();  // of a run that has ended
    const std::scoped_lock lock(mutex_);
    if (aborted_) return absl::UnavailableError("the daemon is stopping");
    return std::exchange(setup_, std::move(setup));
}

std::vector<CameraConnection> Runner::camera_connections() const {
    const auto running = source();
    return running ? running->camera_connections() : std::vector<CameraConnection>{};
}

std::vector<Camera> Runner::cameras() const {
    const std::scoped_lock lock(mutex_);
    return setup_.cameras;
}

bool Runner::set_cameras(std::vector<Camera> cameras) {
    const bool active = is_active(state().state);
    {
        const std::scoped_lock lock(mutex_);
        setup_.next_cameras.reset();
        if (cameras == setup_.cameras) return true;
        setup_.next_cameras = std::move(cameras);
    }
    if (active) return false;
    join_threads();  // of a run that has ended
    take_cameras();
    return true;
}

// While nothing runs.
void Runner::take_cameras() {
    std::vector<Camera> cameras;
    {
        const std::scoped_lock lock(mutex_);
        if (!setup_.next_cameras) return;
        cameras = setup_.cameras = *std::exchange(setup_.next_cameras, std::nullopt);
    }
    setup_.pipeline->set_cameras(cameras);
    if (on_cameras_) on_cameras_(cameras);
}

absl::Status Runner::start() {
    if (is_active(state().state))
        return absl::FailedPreconditionError("the capture is running already; stop it first to restart it");
    join_threads();  // of a run that has ended
    set_state(RunState::kStarting);
    take_cameras();
    absl::Status status = open_source();
    if (status.ok()) {
        if (!background_learned()) status = learn_from_clip();
    }
    if (!status.ok()) {
        set_state(RunState::kFailed, std::string(status.message()));
        publish_event(EventKind::kError, std::string(status.message()));
        return status;
    }
    setup_.pipeline->reset_track();
    statistics_.reset();
    utc_minus_capture_ns_.reset();
    source()->set_on_camera_event([this](const CameraEvent& event) { publish_event(event); });
    live_ = false;
    fetched_.open();
    reconstructed_.open();
    set_state(RunState::kRunning);
    publish_event(EventKind::kCaptureStarted, "capture started");
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
        return absl::FailedPreconditionError("the capture is not running; start it first");
    if (const auto running = source()) running->stop();
    join_threads();
    end_learning(absl::AbortedError("the capture was stopped before the background was learned"));
    {
        const std::scoped_lock lock(mutex_);
        setup_.source.reset();
    }
    if (setup_.observers.on_end) setup_.observers.on_end();
    if (state().state != RunState::kFailed) set_state(RunState::kStopped);
    publish_event(EventKind::kCaptureStopped, "capture stopped");
    return absl::OkStatus();
}

void Runner::abort() {
    std::shared_ptr<FrameSource> running;
    {
        const std::scoped_lock lock(mutex_);
        aborted_ = true;
        running = setup_.source;
    }
    if (running) running->stop();
    close_handovers();
    end_learning(absl::UnavailableError("the daemon is stopping; the background was not learned"));
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
        if (setup_.source) return absl::OkStatus();
    }
    auto opened = setup_.reopen();
    if (!opened.ok()) return opened.status();
    if ((*opened)->cameras() != setup_.own_cameras)
        return absl::FailedPreconditionError(
            "the source's cameras or their calibration have changed since the "
            "daemon was started; restart the daemon");
    const std::scoped_lock lock(mutex_);
    if (aborted_) return absl::UnavailableError("the daemon is stopping");
    setup_.source = std::move(*opened);
    return absl::OkStatus();
}

absl::Status Runner::learn_from_clip() {
    auto images = source()->background();
    if (!images.ok()) return images.status();
    const bool complete =
        !images->empty() && std::ranges::none_of(*images, [](const auto& camera) { return camera.empty(); });
    if (!complete) return absl::OkStatus();  // an operator learns it from live frames
    if (const absl::Status learned = setup_.pipeline->learn_background(*images); !learned.ok())
        return learned;
    const std::size_t count = images->front().size();
    keep_background(*images);
    if (setup_.observers.on_background)
        setup_.observers.on_background(
            std::make_shared<const std::vector<std::vector<Image>>>(*std::move(images)));
    {
        const std::scoped_lock lock(mutex_);
        setup_.background_learned = true;
    }
    publish_event(EventKind::kBackgroundLearned,
                  fmt::format("background learned from the source's {} images per camera", count));
    return absl::OkStatus();
}

void Runner::learn_background(int frames, std::function<void(absl::Status)> done) {
    const RunState now = state().state;
    if (frames < 0 || frames > kMaxLearningFrames)
        return done(absl::InvalidArgumentError(fmt::format(
            "frame_set_count is {}; give 1 to {} live frame sets, or 0 for the source's background images",
            frames, kMaxLearningFrames)));
    if (frames == 0) {
        if (is_active(now))
            return done(
                absl::FailedPreconditionError("the capture is running; stop it to learn from the source's "
                                              "background images, or give a number "
                                              "of live frame sets"));
        absl::Status status = open_source();
        if (status.ok()) {
            {
                const std::scoped_lock lock(mutex_);
                setup_.background_learned = false;
            }
            status = learn_from_clip();
        }
        if (status.ok() && !background_learned())
            status = absl::FailedPreconditionError(
                "the source has no background images; start the capture, clear the scene and give a number "
                "of "
                "live frame sets");
        return done(status);
    }
    if (now != RunState::kRunning)
        return done(absl::FailedPreconditionError(
            now == RunState::kLearning ? "the background is being learned already; wait until it is done"
                                       : "the capture is not running; start it to learn from live frames"));
    std::int64_t set_bytes = 0;
    for (const Camera& camera : setup_.own_cameras)
        set_bytes += std::int64_t{3} * camera.width * camera.height;
    if (set_bytes * frames > kMaxLearningBytes)
        return done(absl::InvalidArgumentError(fmt::format(
            "{} frame sets of these cameras take {} MB while they are collected; give at most {}", frames,
            set_bytes * frames >> 20, std::max<std::int64_t>(1, kMaxLearningBytes / set_bytes))));
    {
        const std::scoped_lock lock(mutex_);
        // The source may have ended since the state was read.
        if (state_.state == RunState::kRunning && !aborted_) {
            state_ = {RunState::kLearning, fmt::format("learning the background from {} frame sets", frames)};
            learner_.begin(frames, setup_.own_cameras.size(), std::move(done));
            return;
        }
    }
    done(absl::FailedPreconditionError("the capture has just ended; start it to learn from live frames"));
}

void Runner::keep_background(const std::vector<std::vector<Image>>& images) {
    std::vector<std::vector<Image>> kept;
    for (const std::vector<Image>& camera : images) {
        auto& selected = kept.emplace_back();
        const std::size_t count = std::min(camera.size(), kKeptBackgroundImages);
        for (std::size_t n = 0; n < count; ++n) selected.push_back(camera[n * camera.size() / count]);
    }
    const std::scoped_lock lock(mutex_);
    if (!setup_.background.empty()) setup_.previous_background = std::move(setup_.background);
    setup_.background = std::move(kept);
}

absl::Status Runner::restore_background() {
    std::vector<std::vector<Image>> images;
    {
        const std::scoped_lock lock(mutex_);
        if (is_active(state_.state))
            return absl::FailedPreconditionError(
                "the capture is running; stop it to restore the previous background");
        images = setup_.previous_background;
    }
    if (images.empty())
        return absl::FailedPreconditionError(
            "no background was replaced since the daemon's start; there is none to restore");
    join_threads();  // of a run that has ended
    if (const absl::Status learned = setup_.pipeline->learn_background(images); !learned.ok()) return learned;
    keep_background(images);
    if (setup_.observers.on_background)
        setup_.observers.on_background(
            std::make_shared<const std::vector<std::vector<Image>>>(std::move(images)));
    {
        const std::scoped_lock lock(mutex_);
        setup_.background_learned = true;
    }
    publish_event(EventKind::kBackgroundLearned, "the previous background was restored");
    return absl::OkStatus();
}

void Runner::fetch_loop() {
    const std::shared_ptr<FrameSource> source = this->source();
    // Of a live source only the latest frame set is useful. Cameras do not wait: one that was not consumed is
    // replaced. The studio renders only what is consumed.
    const bool cameras = !source->camera_connections().empty();
    live_ = cameras;
    for (bool last = false; !last;) {
        if (live_ && !cameras && !fetched_.wait_until_empty()) return;
        const Stopwatch waited;
        Fetched fetched{source->next(), 0};
        fetched.waited_ms = waited.ms();
        last = !fetched.frame_set.ok();
        if (!last) {
            live_ = cameras || is_live(fetched.frame_set->capture_time_ns);
            if (setup_.observers.on_frame_set) setup_.observers.on_frame_set(*fetched.frame_set);
        }
        const bool handed_on =
            cameras && !last ? fetched_.replace(std::move(fetched)) : fetched_.push(std::move(fetched));
        if (!handed_on) return;
    }
}

void Runner::reconstruct_loop() {
    // Of a live source no frame set is begun that would wait for the pose of another: it would be outdated.
    while (!live_ || reconstructed_.wait_until_empty()) {
        std::optional<Fetched> fetched = next_fetched();
        if (!fetched) return;
        reconstructing_.begin();
        absl::StatusOr<std::unique_ptr<Reconstruction>> reconstruction = reconstruct(*std::move(fetched));
        reconstructing_.end();  // while it waits to hand it over, the posing thread is the busy one
        if (reconstruction.ok() && *reconstruction == nullptr) continue;
        const bool last = !reconstruction.ok();
        if (!reconstructed_.push(std::move(reconstruction)) || last) return;
    }
}

// Empty at the end of the run.
std::optional<Runner::Fetched> Runner::next_fetched() {
    while (!fetched_.wait_for_one(idle_timeout_ / 4)) end_idle_learning();
    return fetched_.pop();
}

absl::StatusOr<std::unique_ptr<Reconstruction>> Runner::reconstruct(Fetched fetched) {
    if (!fetched.frame_set.ok()) return fetched.frame_set.status();
    FrameSet frame_set = *std::move(fetched.frame_set);
    if (frame_set.decode_ms == 0) frame_set.decode_ms = fetched.waited_ms;
    if (learner_.active()) {
        learn_from(frame_set);
        return nullptr;
    }
    if (background_learned()) return setup_.pipeline->reconstruct(std::move(frame_set));

    // Images only, so that an operator sees whether the scene is empty.
    auto images_only = std::make_unique<Reconstruction>();
    images_only->result = std::make_shared<FrameResult>();
    images_only->result->sequence = frame_set.sequence;
    images_only->result->capture_time_ns = frame_set.capture_time_ns;
    images_only->result->times.decode_ms = frame_set.decode_ms;
    images_only->result->frame_set = std::move(frame_set);
    return images_only;
}

void Runner::pose_loop() {
    while (auto reconstruction = reconstructed_.pop()) {
        if (!reconstruction->ok()) return end(reconstruction->status());
        posing_.begin();
        const absl::StatusOr<FrameResultPtr> result = setup_.pipeline->pose(**std::move(reconstruction));
        if (result.ok()) publish(*result);
        posing_.end();
        if (!result.ok()) return end(result.status());
    }
}

std::chrono::nanoseconds Runner::max_busy_time(BusyTimer::Clock::time_point now) const {
    return std::max(reconstructing_.elapsed(now), posing_.elapsed(now));
}

void Runner::publish(const FrameResultPtr& result) {
    if (!utc_minus_capture_ns_) {
        utc_minus_capture_ns_ = utc_minus_capture_ns(result->capture_time_ns);
        clock_steps_ = {};
    } else if (const std::int64_t step_ns = clock_steps_.step_ns(); step_ns != 0) {
        *utc_minus_capture_ns_ += step_ns;
        publish_event(
            EventKind::kClockStepped,
            fmt::format(
                "the system clock was set {} by {:.1f} s; stream times follow it, the times of a running "
                "recording stay continuous",
                step_ns > 0 ? "forward" : "back", 1e-9 * static_cast<double>(std::abs(step_ns))),
            result->sequence);
    }
    if (result_observer_) result_observer_(*result);
    statistics_.add(result->sequence, result->times);
    hub_.publish(result, *utc_minus_capture_ns_);
}

// The last action of a run's threads, unless stop() or abort() came first.
void Runner::end(const absl::Status& why) {
    if (absl::IsCancelled(why)) return;
    const bool ended = absl::IsOutOfRange(why);
    end_learning(absl::AbortedError(ended ? "the source ended before the background was learned"
                                          : "the capture failed before the background was learned"));
    const std::string message = ended ? "the source has ended" : std::string(why.message());
    set_state(ended ? RunState::kEnded : RunState::kFailed, message);
    publish_event(ended ? EventKind::kSourceEnded : EventKind::kError, message,
                  ended ? statistics_.snapshot().latest_sequence : 0);
    close_handovers();  // ends the other threads
    {
        const std::scoped_lock lock(mutex_);
        if (setup_.source) setup_.source->stop();
        setup_.source.reset();
    }
    if (setup_.observers.on_end) setup_.observers.on_end();
}

void Runner::learn_from(const FrameSet& frame_set) {
    std::optional<CollectedBackground> collected = learner_.add(frame_set);
    if (!collected) return;
    absl::Status status = collected->check();
    if (status.ok()) status = setup_.pipeline->learn_background(collected->images);
    if (status.ok()) setup_.pipeline->reset_track();
    if (status.ok()) keep_background(collected->images);
    if (status.ok() && setup_.observers.on_background)
        setup_.observers.on_background(
            std::make_shared<const std::vector<std::vector<Image>>>(std::move(collected->images)));
    {
        const std::scoped_lock lock(mutex_);
        if (status.ok()) setup_.background_learned = true;
        if (state_.state == RunState::kLearning) state_ = {RunState::kRunning, {}};
    }
    if (status.ok())
        publish_event(EventKind::kBackgroundLearned,
                      fmt::format("background learned from {} live frame sets", collected->wanted),
                      frame_set.sequence);
    collected->done(status);
}

// Without it the caller would wait until their own deadline for cameras that are not triggered.
void Runner::end_idle_learning() {
    const std::optional<CollectedBackground> idle = learner_.take_idle(idle_timeout_);
    if (!idle) return;
    {
        const std::scoped_lock lock(mutex_);
        if (state_.state == RunState::kLearning) state_ = {RunState::kRunning, {}};
    }
    idle->done(absl::FailedPreconditionError(
        fmt::format("no frame set for {:g} s, after {} of {}; check that the cameras deliver images",
                    std::chrono::duration<double>(idle_timeout_).count(), idle->seen, idle->wanted)));
}

void Runner::end_learning(absl::Status status) {
    if (const auto collected = learner_.take()) collected->done(std::move(status));
}

bool Runner::background_learned() const {
    const std::scoped_lock lock(mutex_);
    return setup_.background_learned;
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

void Runner::publish_event(const CameraEvent& event) {
    const auto kind = [&] {
        switch (event.kind) {
            case CameraEvent::Kind::kDisconnected:
                return EventKind::kCameraDisconnected;
            case CameraEvent::Kind::kReconnected:
                return EventKind::kCameraReconnected;
            case CameraEvent::Kind::kImagesLost:
                break;
        }
        return EventKind::kCameraImagesLost;
    }();
    hub_.events().publish({kind, 0, 0, setup_.own_cameras.at(event.camera).name, event.message});
}

void Runner::publish_event(EventKind kind, std::string message, std::uint64_t sequence) {
    hub_.events().publish(kind, std::move(message), sequence);
}

}  // namespace kinevox
