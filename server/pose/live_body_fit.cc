#include "server/pose/live_body_fit.h"

#include <fmt/format.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <utility>

#include "common/background_priority.h"

namespace kinevox {
namespace {

constexpr double kMaxRate_hz = 30;
constexpr double kMaxFrames =
    80;  // maximum number kept; each takes 0.3 MB and 50 ms of one core with four cameras
constexpr double kMaxWait_s = 20;  // for a subject after a request
constexpr int kAttempts = 3;       // automatic ones

double seconds_between(std::int64_t from_ns, std::int64_t to_ns) {
    return 1e-9 * static_cast<double>(to_ns - from_ns);
}

}  // namespace

LiveBodyFit::LiveBodyFit(std::vector<Camera> cameras, double fps, const PoseStageOptions& posing,
                         const LiveBodyFitOptions& options, OnProgress on_progress)
    : fps_(fps),
      posing_(posing),
      options_(options),
      on_progress_(std::move(on_progress)),
      cameras_(std::make_shared<const std::vector<Camera>>(std::move(cameras))),
      attempts_left_(options.automatic ? kAttempts : 0) {
    progress_.body = posing.body;
    worker_ = std::thread([this] { fit_loop(); });
}

LiveBodyFit::~LiveBodyFit() {
    close();
    worker_.join();
}

void LiveBodyFit::close() {
    const std::scoped_lock lock(mutex_);
    closed_ = true;
    stop_.request_stop();
    changed_.notify_all();
}

absl::Status LiveBodyFit::start(double seconds) {
    if (!(seconds >= kMinSeconds && seconds <= kMaxSeconds))
        return absl::InvalidArgumentError(
            fmt::format("duration is {} s; {} to {} s is allowed", seconds, kMinSeconds, kMaxSeconds));
    {
        const std::scoped_lock lock(mutex_);
        if (closed_) return absl::UnavailableError("the daemon is shutting down; the body is not fitted");
        begin(seconds, true);
    }
    report();
    return absl::OkStatus();
}

// With the mutex held.
void LiveBodyFit::begin(double seconds, bool requested) {
    stop_.request_stop();
    to_fit_.reset();
    collecting_.emplace(Collecting{});
    collecting_->seconds = seconds;
    collecting_->requested = requested;
    if (requested) attempts_left_ = 0;  // an automatic fit does not replace a requested one
    progress_.state = BodyFitState::kCollecting;
    progress_.progress = 0;
    progress_.requested = requested;
    progress_.message.clear();
}

void LiveBodyFit::observe(std::int64_t time_ns, const PoseObservation* seen) {
    bool changed = false;
    {
        const std::scoped_lock lock(mutex_);
        if (std::exchange(last_time_ns_, time_ns) >
            time_ns) {  // a replay restarted, possibly with another subject
            if (collecting_)
                begin(collecting_->seconds, collecting_->requested), changed = true;
            else if (options_.automatic && !progress_.requested)
                attempts_left_ = kAttempts;
        }
        if (!collecting_ && seen && attempts_left_ > 0 && progress_.state != BodyFitState::kFitting) {
            --attempts_left_;
            begin(options_.automatic_duration_s, false);
            changed = true;
        }
        if (!collecting_ || closed_) return;
        Collecting& collecting = *collecting_;
        if (!collecting.requested_ns) collecting.requested_ns = time_ns;
        const double before = progress_.progress;
        if (seen) {
            keep(time_ns, *seen);
        } else if (collecting.requested && collecting.frames.empty() &&
                   seconds_between(*collecting.requested_ns, time_ns) > kMaxWait_s) {
            collecting_.reset();
            progress_.state = BodyFitState::kFailed;
            progress_.message =
                fmt::format("no subject for {} s; step into the capture space and try again", kMaxWait_s);
            changed = true;
        }
        changed =
            changed || static_cast<int>(10 * before) != static_cast<int>(10 * progress_.progress) || to_fit_;
    }
    if (changed) report();
}

// With the mutex held. Keeps observations evenly spaced in time.
void LiveBodyFit::keep(std::int64_t time_ns, const PoseObservation& seen) {
    Collecting& collecting = *collecting_;
    if (!collecting.first_ns) collecting.first_ns = time_ns;
    const double apart_s = std::max(1 / kMaxRate_hz, collecting.seconds / kMaxFrames);
    constexpr double kJitter = 0.75;  // fraction of the spacing after which the next one is accepted
    if (!collecting.last_ns || seconds_between(*collecting.last_ns, time_ns) >= kJitter * apart_s) {
        auto frame = std::make_unique<PoseObservation>(seen);
        for (std::size_t c = 0; c < frame->views.size() && c < cameras_->size(); ++c)
            if (frame->views[c].camera)
                frame->views[c].camera = &(*cameras_)[c];  // outlives the pipeline's cameras
        collecting.frames.push_back(std::move(frame));
        collecting.last_ns = time_ns;
    }
    progress_.progress =
        std::clamp(seconds_between(*collecting.first_ns, time_ns) / collecting.seconds, 0.0, 1.0);
    if (progress_.progress < 1) return;
    to_fit_ = ToFit{cameras_, std::move(collecting.frames), collecting.requested && !options_.file.empty()};
    collecting_.reset();
    stop_ = std::stop_source();
    progress_.state = BodyFitState::kFitting;
    progress_.progress = 0;
    changed_.notify_all();
}

void LiveBodyFit::set_cameras(std::vector<Camera> cameras) {
    const std::scoped_lock lock(mutex_);
    cameras_ = std::make_shared<const std::vector<Camera>>(std::move(cameras));
    if (!collecting_) return;
    const Collecting before = std::move(*collecting_);
    begin(before.seconds, before.requested);
}

std::optional<BodyFit> LiveBodyFit::take_fit() {
    const std::scoped_lock lock(mutex_);
    return std::exchange(fresh_, std::nullopt);
}

BodyFitProgress LiveBodyFit::progress() const {
    const std::scoped_lock lock(mutex_);
    return progress_;
}

void LiveBodyFit::report() {
    if (on_progress_) on_progress_(progress());
}

void LiveBodyFit::fit_loop() {
    lower_this_threads_priority();     // the capture has priority
    oneapi::tbb::task_arena alone(1);  // not the pipeline's workers
    while (true) {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return closed_ || to_fit_; });
        if (closed_) return;
        const ToFit job = std::move(*to_fit_);
        to_fit_.reset();
        const std::stop_token stop = stop_.get_token();
        lock.unlock();
        alone.execute([&] { fit(job, stop); });
    }
}

void LiveBodyFit::fit(const ToFit& job, std::stop_token stop) {
    std::vector<const PoseObservation*> seen;
    for (const auto& frame : job.frames) seen.push_back(frame.get());
    const auto fitted =
        fit_body(*job.cameras, fps_, seen, posing_.body, posing_, options_.fit, stop, [&](double progress) {
            {
                const std::scoped_lock lock(mutex_);
                if (stop.stop_requested()) return;
                const bool same =
                    static_cast<int>(10 * progress) == static_cast<int>(10 * progress_.progress);
                progress_.progress = progress;
                if (same) return;
            }
            report();
        });
    // Stores before applying, so that the active body is always on disk.
    absl::Status stored;
    if (fitted.ok() && job.store) stored = write_body_shape(fitted->shape, options_.file);
    {
        const std::scoped_lock lock(mutex_);
        if (stop.stop_requested()) return;  // superseded by another fit
        if (!fitted.ok()) {
            progress_.state = BodyFitState::kFailed;
            progress_.message = std::string(fitted.status().message());
        } else {
            attempts_left_ = 0;
            fresh_ = *fitted;
            progress_.state = BodyFitState::kReady;
            progress_.progress = 1;
            progress_.body = fitted->shape;
            progress_.fit = *fitted;
            progress_.stored_path = job.store && stored.ok() ? options_.file : std::filesystem::path();
            progress_.message = fmt::format(
                "stature {:.2f} m, fitted to {} frame sets, contour residual {:.0f} mm{}",
                fitted->shape.stature_m, fitted->frame_set_count, 1000 * fitted->contour_residual_rms_m,
                !job.store    ? ""
                : stored.ok() ? "; stored in " + options_.file.string()
                              : "; cannot be stored: " + std::string(stored.message()));
        }
    }
    report();
}

}  // namespace kinevox
