#include "server/pose/live_body_fit.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/background_priority.h"

namespace kinevox {
namespace {

constexpr double kMaxRate_hz = 30;
constexpr double kMaxFrames =
    80;  // maximum number kept; each takes 0.3 MB and 50 ms of one core with four cameras
constexpr double kMaxWait_s = 20;               // for a subject after a request
constexpr double kReportGone_s = 60;            // whether a requested fit succeeded
constexpr int kAttempts = 3;                    // automatic ones
constexpr int kNicer = 5;                       // than the pipeline's threads: a third of a busy core
constexpr double kUnsettledStd_fraction = 0.5;  // of the initial body's standard deviation

double seconds_between(std::int64_t from_ns, std::int64_t to_ns) {
    return 1e-9 * static_cast<double>(to_ns - from_ns);
}

}  // namespace

LiveBodyFit::LiveBodyFit(std::vector<Camera> cameras, double fps, const PoseStageOptions& posing,
                         const LiveBodyFitOptions& options, Observers observers)
    : fps_(fps),
      posing_(posing),
      options_(options),
      observers_(std::move(observers)),
      cameras_(std::make_shared<const std::vector<Camera>>(std::move(cameras))) {
    subject_of(0);
    worker_ = std::thread([this] {
        lower_this_threads_priority_by(kNicer);
        fit_loop(false);
    });
    // Without a body of their own poses are worth little: it has the capture's priority.
    preliminary_worker_ = std::thread([this] { fit_loop(true); });
}

LiveBodyFit::~LiveBodyFit() {
    close();
    worker_.join();
    preliminary_worker_.join();
}

void LiveBodyFit::close() {
    const std::scoped_lock lock(mutex_);
    closed_ = true;
    for (auto& [key, subject] : subjects_) subject.stop.request_stop();
    changed_.notify_all();
}

absl::Status LiveBodyFit::start(std::uint32_t subject_id, double seconds) {
    if (!(seconds >= kMinSeconds && seconds <= kMaxSeconds))
        return absl::InvalidArgumentError(
            fmt::format("duration is {} s; {} to {} s is allowed", seconds, kMinSeconds, kMaxSeconds));
    {
        const std::scoped_lock lock(mutex_);
        if (closed_) return absl::UnavailableError("the daemon is shutting down; the body is not fitted");
        begin(options_.several_subjects ? subject_id : 0, seconds, true);
    }
    report({});
    return absl::OkStatus();
}

void LiveBodyFit::capture_ended() {
    const std::scoped_lock lock(mutex_);
    run_ended_ = true;
}

LiveBodyFit::Subject& LiveBodyFit::subject_of(std::uint32_t key) {
    const auto [found, is_new] = subjects_.try_emplace(key);
    Subject& subject = found->second;
    if (!is_new) return subject;
    subject.progress.subject_id = key;
    subject.progress.body = posing_.body;
    if (options_.automatic) subject.attempts_left = kAttempts;
    return subject;
}

void LiveBodyFit::cancel(std::uint32_t key) {
    subject_of(key).stop.request_stop();
    subject_of(key).preliminary_runs = false;
    std::erase_if(to_fit_, [key](const ToFit& job) { return job.key == key; });
}

void LiveBodyFit::begin(std::uint32_t key, double seconds, bool requested) {
    cancel(key);
    Subject& subject = subject_of(key);
    subject.collecting.emplace(Collecting{});
    subject.collecting->seconds = seconds;
    subject.collecting->requested = requested;
    if (requested) subject.attempts_left = 0;  // an automatic fit does not replace a requested one
    subject.progress.state = BodyFitState::kCollecting;
    subject.progress.progress = 0;
    subject.progress.requested = requested;
    subject.progress.message.clear();
}

void LiveBodyFit::fail(Subject& subject, std::string message, Ended& ended) {
    subject.collecting.reset();
    subject.progress.state = BodyFitState::kFailed;
    subject.progress.message = std::move(message);
    ended.push_back(subject.progress);
}

// A replay restarted, possibly with another subject, or the capture did: then ids are of others, too.
bool LiveBodyFit::restart() {
    if (!options_.several_subjects) {
        Subject& only = subjects_[0];
        if (only.collecting) {
            begin(0, only.collecting->seconds, only.collecting->requested);
            return true;
        }
        if (options_.automatic && !only.progress.requested) only.attempts_left = kAttempts;
        return false;
    }
    for (auto& [key, subject] : subjects_)
        if (key != 0) cancel(key);
    std::erase_if(subjects_, [](const auto& each) { return each.first != 0; });
    if (Subject& next = subjects_[0]; next.collecting) begin(0, next.collecting->seconds, true);
    return true;
}

bool LiveBodyFit::observe_one(std::uint32_t key, std::int64_t time_ns, const Seen& seen, Ended& ended) {
    Subject& subject = subject_of(key);
    bool changed = false;
    if (!subject.collecting && seen.observation && subject.attempts_left > 0 &&
        subject.progress.state != BodyFitState::kFitting) {
        --subject.attempts_left;
        begin(key, options_.automatic_duration_s, false);
        changed = true;
    }
    if (!subject.collecting) return changed;
    Collecting& collecting = *subject.collecting;
    if (!collecting.requested_ns) collecting.requested_ns = time_ns;
    const double before = subject.progress.progress;
    if (seen.observation) {
        keep(key, time_ns, seen);
    } else if (collecting.requested && collecting.frames.empty() &&
               seconds_between(*collecting.requested_ns, time_ns) > kMaxWait_s) {
        fail(subject,
             fmt::format("no subject for {} s; step into the capture space and try again", kMaxWait_s),
             ended);
        return true;
    }
    return changed || static_cast<int>(10 * before) != static_cast<int>(10 * subject.progress.progress) ||
           !subject.collecting;
}

bool LiveBodyFit::observe_lone(std::int64_t time_ns, std::span<const Seen> tracked, Ended& ended) {
    const std::uint32_t id = tracked.empty() ? 0 : tracked.front().subject_id;
    bool changed = false;
    if (id != 0 && std::exchange(lone_id_, id) != id) changed = change_lone(id);
    subjects_[0].progress.subject_id = id;
    return observe_one(0, time_ns, tracked.empty() ? Seen() : tracked.front(), ended) || changed;
}

// Another person, or one not recognised, takes the place of the last one.
bool LiveBodyFit::change_lone(std::uint32_t id) {
    Subject& lone = subjects_[0];
    if (lone.progress.requested || (lone.collecting && lone.collecting->requested)) return false;
    cancel(0);
    lone.collecting.reset();
    if (const auto known = lone_fits_.find(id); known != lone_fits_.end()) {
        lone.progress = known->second;
        lone.attempts_left = 0;
        return true;
    }
    lone.attempts_left = options_.automatic ? kAttempts : 0;
    lone.progress.state = lone.progress.fit ? BodyFitState::kReady : BodyFitState::kNotStarted;
    lone.progress.progress = lone.progress.fit ? 1 : 0;
    return true;
}

bool LiveBodyFit::observe_several(std::int64_t time_ns, std::span<const Seen> tracked, Ended& ended) {
    bool changed = observe_gone(time_ns, tracked, ended);
    for (const Seen& seen : tracked) {
        const bool is_new = !subjects_.contains(seen.subject_id);
        Subject& subject = subject_of(seen.subject_id);
        changed = subject.gone_since_ns || is_new || changed;
        subject.gone_since_ns.reset();
        Subject& next = subjects_[0];
        if (next.collecting) {  // it waited for this one
            begin(seen.subject_id, next.collecting->seconds, true);
            next.collecting.reset();
            next.progress.state = BodyFitState::kNotStarted;
            next.progress.requested = false;
            changed = true;
        }
        changed = observe_one(seen.subject_id, time_ns, seen, ended) || changed;
    }
    if (tracked.empty()) changed = observe_one(0, time_ns, {}, ended) || changed;
    return changed;
}

bool LiveBodyFit::observe_gone(std::int64_t time_ns, std::span<const Seen> tracked, Ended& ended) {
    bool changed = false;
    auto oldest = subjects_.end();
    for (auto at = subjects_.begin(); at != subjects_.end(); ++at) {
        auto& [key, subject] = *at;
        if (key == 0 || std::ranges::find(tracked, key, &Seen::subject_id) != tracked.end()) continue;
        if (!subject.gone_since_ns) {
            subject.gone_since_ns = time_ns;
            changed = true;
        }
        if (oldest == subjects_.end() || subject.gone_since_ns < oldest->second.gone_since_ns) oldest = at;
        if (!subject.collecting) continue;
        if (!subject.collecting->requested) {
            subject.collecting.reset();  // its observations take memory, and no client waits for it
            subject.progress.state = subject.progress.fit ? BodyFitState::kReady : BodyFitState::kNotStarted;
        } else if (seconds_between(*subject.gone_since_ns, time_ns) > kMaxWait_s) {
            fail(subject, fmt::format("subject {} has left; step into the capture space and try again", key),
                 ended);
            changed = true;
        }
    }
    if (subjects_.size() > kMaxSubjects && oldest != subjects_.end()) {
        cancel(oldest->first);
        subjects_.erase(oldest);
    }
    return changed;
}

void LiveBodyFit::observe(std::int64_t time_ns, std::span<const Seen> tracked) {
    Ended ended;
    bool changed = false;
    {
        const std::scoped_lock lock(mutex_);
        const bool back = std::exchange(last_time_ns_, time_ns) > time_ns;
        const bool run_ended = std::exchange(run_ended_, false);
        if (back || run_ended) {
            lone_id_ = 0;
            lone_fits_.clear();
        }
        if (back || (run_ended && options_.several_subjects)) changed = restart();
        if (closed_) return;
        changed = (options_.several_subjects ? observe_several(time_ns, tracked, ended)
                                             : observe_lone(time_ns, tracked, ended)) ||
                  changed;
    }
    if (changed) report(ended);
}

// Keeps observations evenly spaced in time.
void LiveBodyFit::keep(std::uint32_t key, std::int64_t time_ns, const Seen& seen) {
    Subject& subject = subject_of(key);
    Collecting& collecting = *subject.collecting;
    if (!collecting.first_ns) collecting.first_ns = time_ns;
    const double apart_s = std::max(1 / kMaxRate_hz, collecting.seconds / kMaxFrames);
    constexpr double kJitter = 0.75;  // fraction of the spacing after which the next one is accepted
    if (!collecting.last_ns || seconds_between(*collecting.last_ns, time_ns) >= kJitter * apart_s) {
        auto frame = std::make_shared<PoseObservation>(*seen.observation);
        for (std::size_t c = 0; c < frame->views.size() && c < cameras_->size(); ++c)
            if (frame->views[c].camera)
                frame->views[c].camera = &(*cameras_)[c];  // outlives the pipeline's cameras
        collecting.frames.push_back(
            {std::move(frame), seen.posture ? std::optional(*seen.posture) : std::nullopt});
        collecting.last_ns = time_ns;
    }
    const double collected_s = seconds_between(*collecting.first_ns, time_ns);
    subject.progress.progress = std::clamp(collected_s / collecting.seconds, 0.0, 1.0);
    if (subject.progress.progress < 1) return begin_preliminary(key);
    enqueue(key, std::move(collecting.frames), 0);
    subject.collecting.reset();
    subject.progress.state = BodyFitState::kFitting;
    subject.progress.progress = 0;
}

// If another one is due and none runs.
void LiveBodyFit::begin_preliminary(std::uint32_t key) {
    Subject& subject = subject_of(key);
    if (!subject.collecting || subject.collecting->requested || subject.preliminary_runs) return;
    Collecting& collecting = *subject.collecting;
    if (collecting.frames.empty()) return;
    const auto& times_s = options_.preliminary_durations_s;
    const double collected_s = seconds_between(*collecting.first_ns, *collecting.last_ns);
    const auto due =
        static_cast<std::size_t>(std::ranges::upper_bound(times_s, collected_s) - times_s.begin());
    if (due <= collecting.preliminary_times) return;
    collecting.preliminary_times = due;
    enqueue(key, collecting.frames, ++collecting.preliminary_count);
}

void LiveBodyFit::enqueue(std::uint32_t key, Frames frames, int preliminary) {
    cancel(key);  // a preliminary fit that is still running
    Subject& subject = subject_of(key);
    subject.stop = std::stop_source();
    subject.preliminary_runs = preliminary > 0;
    const bool store = subject.progress.requested && !options_.file.empty();
    to_fit_.push_back({.key = key,
                       .cameras = cameras_,
                       .frames = std::move(frames),
                       .start = subject.progress.body,
                       .preliminary = preliminary,
                       .store = store,
                       .stop = subject.stop.get_token()});
    changed_.notify_all();
}

void LiveBodyFit::refit() {
    const std::scoped_lock lock(mutex_);
    lone_fits_.clear();
    for (auto& [key, subject] : subjects_) {
        if (subject.progress.requested || !options_.automatic) continue;
        cancel(key);
        subject.collecting.reset();
        subject.attempts_left = kAttempts;
        subject.awaits_refit = true;
        subject.before_refit = subject.progress;
        subject.progress.state = BodyFitState::kNotStarted;
    }
}

void LiveBodyFit::undo_refit() {
    {
        const std::scoped_lock lock(mutex_);
        lone_fits_.clear();
        for (auto& [key, subject] : subjects_) {
            subject.awaits_refit = false;
            if (!subject.before_refit || subject.progress.requested) continue;
            cancel(key);
            subject.collecting.reset();
            const std::uint32_t id = subject.progress.subject_id;
            subject.progress = *std::exchange(subject.before_refit, std::nullopt);
            subject.progress.subject_id = id;
            const bool is_ready = subject.progress.state == BodyFitState::kReady;
            subject.attempts_left = is_ready ? 0 : kAttempts;
            subject.is_preliminary = !is_ready;
            subject.is_unsettled = false;
        }
    }
    report({});
}

void LiveBodyFit::set_cameras(std::vector<Camera> cameras) {
    const std::scoped_lock lock(mutex_);
    cameras_ = std::make_shared<const std::vector<Camera>>(std::move(cameras));
    for (auto& [key, subject] : subjects_)
        if (subject.collecting) begin(key, subject.collecting->seconds, subject.collecting->requested);
}

BodyInUse LiveBodyFit::body_in_use(std::uint32_t subject_id) const {
    const std::scoped_lock lock(mutex_);
    const auto found = subjects_.find(options_.several_subjects ? subject_id : 0);
    if (found == subjects_.end() || !found->second.progress.fit) return posing_.initial_body();
    const BodyFit& fit = *found->second.progress.fit;
    return {fit.shape, fit.standing_m,
            found->second.is_unsettled ? kUnsettledStd_fraction * posing_.body_std_m : 0};
}

// With the mutex held.
bool LiveBodyFit::is_reported(std::uint32_t key, const Subject& subject) const {
    if (key == 0) return subjects_.size() == 1;
    return !subject.gone_since_ns || (subject.progress.requested &&
                                      seconds_between(*subject.gone_since_ns, last_time_ns_) < kReportGone_s);
}

bool LiveBodyFit::awaits_refit(std::uint32_t subject_id) const {
    const std::scoped_lock lock(mutex_);
    const auto found = subjects_.find(options_.several_subjects ? subject_id : 0);
    return found != subjects_.end() && found->second.awaits_refit;
}

std::vector<BodyFitProgress> LiveBodyFit::progress() const {
    const std::scoped_lock lock(mutex_);
    std::vector<BodyFitProgress> all;
    for (const auto& [key, subject] : subjects_)
        if (is_reported(key, subject)) all.push_back(subject.progress);
    if (all.empty()) all.push_back(subjects_.at(0).progress);
    return all;
}

void LiveBodyFit::report(const Ended& ended) {
    if (observers_.on_progress) observers_.on_progress(progress());
    if (observers_.on_end)
        for (const BodyFitProgress& each : ended) observers_.on_end(each);
}

}  // namespace kinevox
