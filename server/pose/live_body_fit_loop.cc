// The threads of LiveBodyFit: they fit what it has collected.
#include <fmt/format.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "server/pose/live_body_fit.h"

namespace kinevox {
namespace {

// Of a preliminary fit, which must be there soon.
constexpr int kPreliminaryFrames = 8, kPreliminarySteps = 6;
// Preliminary bodies of the right size have 8 to 20 mm, of a wrong one 22 to 31.
constexpr double kFittingResidual_m = 0.019, kSearchedFraction = 0.8;
// Those that may search postures: not the first, which must be there soon, nor later ones, since silhouettes
// of a poor background never fit.
constexpr int kFirstSearch = 2, kLastSearch = 3;
constexpr int kSearchRounds = 1, kSearchSizeFrames = 1;
constexpr std::size_t kSearchFrames = 4;

void set_fit(const BodyFit& fit, BodyFitProgress& progress) {
    progress.body = fit.shape;
    progress.fit = fit;
    progress.stored_path.clear();
    progress.message =
        fmt::format("stature {:.2f} m, fitted to {} frame sets, contour residual {:.0f} mm",
                    fit.shape.stature_m, fit.frame_set_count, 1000 * fit.contour_residual_rms_m);
}

// Whether two fits can be of one person.
bool may_be_same_person(const BodyFit& a, const BodyFit& b) {
    constexpr double kMaxStds = 3;
    const auto near = [](double difference, double std_a, double std_b) {
        return std::abs(difference) <= kMaxStds * std::hypot(std_a, std_b);
    };
    for (int k = 0; k < kBodyLengthCount; ++k)
        if (!near(a.shape.lengths_m[k] - b.shape.lengths_m[k], a.lengths_std_m[k], b.lengths_std_m[k]))
            return false;
    return near(a.shape.stature_m - b.shape.stature_m, a.stature_std_m, b.stature_std_m);
}

}  // namespace

std::vector<const PoseObservation*> LiveBodyFit::observations_of(const Frames& frames) {
    std::vector<const PoseObservation*> seen;
    for (const Frame& frame : frames) seen.push_back(frame.seen.get());
    return seen;
}

void LiveBodyFit::fit_loop(bool preliminary) {
    oneapi::tbb::task_arena alone(1);  // not the pipeline's workers
    while (true) {
        std::unique_lock lock(mutex_);
        auto next = to_fit_.end();
        changed_.wait(lock, [&] {
            next = std::ranges::find_if(
                to_fit_, [&](const ToFit& job) { return (job.preliminary > 0) == preliminary; });
            return closed_ || next != to_fit_.end();
        });
        if (closed_) return;
        const ToFit job = std::move(*next);
        to_fit_.erase(next);
        lock.unlock();
        alone.execute([&] { fit(job); });
    }
}

// To the tracked postures. If most are missing or the body does not fit, as if it had another size, postures
// and size are searched.
std::optional<BodyFit> LiveBodyFit::fit_preliminary(const ToFit& job) const {
    BodyFitOptions fitting = options_.fit;
    fitting.max_frames = std::min(fitting.max_frames, kPreliminaryFrames);
    fitting.steps = std::min(fitting.steps, kPreliminarySteps);
    std::vector<ObservedPosture> posed;
    for (const Frame& frame : job.frames)
        if (frame.posture) posed.push_back({frame.seen.get(), *frame.posture});
    std::optional<BodyFit> tracked;
    if (2 * posed.size() >= job.frames.size())
        tracked = fit_lengths(posed, job.start, false, posing_, fitting, job.stop);
    const bool may_search = job.preliminary >= kFirstSearch && job.preliminary <= kLastSearch;
    if (!may_search || (tracked && tracked->contour_residual_rms_m < kFittingResidual_m)) return tracked;
    fitting.rounds = kSearchRounds, fitting.size_frames = kSearchSizeFrames, fitting.quick = true;
    const std::vector<const PoseObservation*> all = observations_of(job.frames);
    const auto latest = std::span(all).last(std::min(all.size(), kSearchFrames));
    const auto searched = fit_body(*job.cameras, fps_, latest, tracked ? tracked->shape : posing_.body,
                                   posing_, fitting, job.stop);
    const bool is_better =
        searched.ok() &&
        (!tracked || searched->contour_residual_rms_m < kSearchedFraction * tracked->contour_residual_rms_m);
    return is_better ? std::optional(*searched) : tracked;
}

void LiveBodyFit::fit(const ToFit& job) {
    if (job.preliminary > 0) {
        if (use_preliminary(job, fit_preliminary(job))) report({});
        return;
    }
    const auto show = [&](double progress) {
        {
            const std::scoped_lock lock(mutex_);
            if (job.stop.stop_requested()) return;
            double& shown = subjects_.at(job.key).progress.progress;
            const bool same = static_cast<int>(10 * progress) == static_cast<int>(10 * shown);
            shown = progress;
            if (same) return;
        }
        report({});
    };
    const auto fitted = fit_body(*job.cameras, fps_, observations_of(job.frames), posing_.body, posing_,
                                 options_.fit, job.stop, show);
    // Stores before applying, so that the active body is always on disk.
    absl::Status stored;
    if (fitted.ok() && job.store) stored = write_body_shape(fitted->shape, options_.file);
    Ended ended;
    {
        const std::scoped_lock lock(mutex_);
        if (job.stop.stop_requested()) return;  // superseded by another fit
        Subject& subject = subjects_.at(job.key);
        if (!fitted.ok()) {
            fail(subject, std::string(fitted.status().message()), ended);
        } else {
            BodyFitProgress& progress = subject.progress;
            subject.attempts_left = 0;
            subject.awaits_refit = subject.is_preliminary = subject.is_unsettled = false;
            progress.state = BodyFitState::kReady;
            progress.progress = 1;
            set_fit(*fitted, progress);
            if (job.store && stored.ok()) progress.stored_path = options_.file;
            if (job.store)
                progress.message += stored.ok() ? "; stored in " + options_.file.string()
                                                : "; cannot be stored: " + std::string(stored.message());
            if (lone_id_ != 0 && !progress.requested) {
                lone_fits_.insert_or_assign(lone_id_, progress);
                if (lone_fits_.size() > kMaxSubjects) lone_fits_.erase(lone_fits_.begin());  // ids ascend
            }
            ended.push_back(progress);
        }
    }
    report(ended);
}

// A fitted body of the same person stays in use: it is of more frame sets.
bool LiveBodyFit::use_preliminary(const ToFit& job, const std::optional<BodyFit>& fit) {
    const std::scoped_lock lock(mutex_);
    if (job.stop.stop_requested()) return false;
    Subject& subject = subjects_.at(job.key);
    subject.preliminary_runs = false;
    BodyFitProgress& progress = subject.progress;
    const auto keeps_body = [&] {
        const bool is_of_more = progress.fit && !subject.is_preliminary;
        return !subject.awaits_refit && is_of_more && may_be_same_person(*fit, *progress.fit);
    };
    const bool used = fit && !keeps_body();
    if (used) {
        subject.is_preliminary = true;
        subject.is_unsettled = job.preliminary == 1;
        set_fit(*fit, progress);
    }
    if (fit) subject.awaits_refit = false;
    begin_preliminary(job.key);  // from that body
    return used;
}

}  // namespace kinevox
