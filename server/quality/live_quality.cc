#include "server/quality/live_quality.h"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <utility>

#include "common/background_priority.h"

namespace kinevox::quality {

LiveQuality::LiveQuality(const LiveQualityOptions& options)
    : options_(options), thread_([this] {
          lower_this_threads_priority();
          // One thread: the pipeline's workers have other tasks.
          oneapi::tbb::task_arena arena(1);
          arena.execute([this] { work(); });
      }) {}

LiveQuality::~LiveQuality() {
    {
        const std::scoped_lock lock(mutex_);
        closing_ = true;
    }
    changed_.notify_all();
    thread_.join();
}

void LiveQuality::set_background(std::vector<Camera> cameras,
                                 std::shared_ptr<const std::vector<std::vector<Image>>> background) {
    const std::scoped_lock lock(mutex_);
    cameras_ = std::make_shared<const std::vector<Camera>>(std::move(cameras));
    background_ = std::move(background);
    begin_again();
}

void LiveQuality::set_cameras(std::vector<Camera> cameras) {
    const std::scoped_lock lock(mutex_);
    cameras_ = std::make_shared<const std::vector<Camera>>(std::move(cameras));
    begin_again();
}

void LiveQuality::set_judge_faint(bool judge) {
    const std::scoped_lock lock(mutex_);
    if (std::exchange(judge_faint_, judge) != judge) begin_again();
}

void LiveQuality::begin_again() {
    restart_ = true;
    next_.reset();
    report_.reset();
}

void LiveQuality::observe(const FrameResult& result, const BodyOf& body_of) {
    {
        const std::scoped_lock lock(mutex_);
        const std::int64_t since = result.capture_time_ns - last_time_ns_;
        if (!background_ || next_ || (since >= 0 && since < options_.sample_interval.count())) return;
        last_time_ns_ = result.capture_time_ns;
        next_ = std::make_unique<Observed>();
        next_->result.sequence = result.sequence;
        next_->result.frame_set = result.frame_set;
        next_->result.subjects = result.subjects;
        const auto take_body = [&](std::uint32_t key, std::uint32_t subject_id) {
            if (const BodyShape* const body = body_of(subject_id)) next_->bodies[key] = *body;
        };
        if (!options_.several_subjects) take_body(0, 0);
        if (options_.several_subjects)
            for (const SubjectResult& subject : result.subjects)
                take_body(subject.track.subject_id, subject.track.subject_id);
    }
    changed_.notify_all();
}

std::shared_ptr<const QualityReport> LiveQuality::report() const {
    const std::scoped_lock lock(mutex_);
    return report_;
}

void LiveQuality::work() {
    for (;;) {
        std::unique_ptr<Observed> one;
        bool restart = false;
        std::shared_ptr<const std::vector<Camera>> cameras;
        std::shared_ptr<const std::vector<std::vector<Image>>> background;
        ObserverOptions observing{
            .max_side_px = options_.max_side_px, .max_samples = options_.samples, .latest = true};
        {
            std::unique_lock lock(mutex_);
            changed_.wait(lock, [&] { return closing_ || next_; });
            if (closing_) return;
            one = std::move(next_);
            restart = std::exchange(restart_, false);
            cameras = cameras_;
            background = background_;
            observing.judge_faint = judge_faint_;
        }
        if (restart) {
            observer_.reset();
            subjects_.clear();
            since_judged_ = 0;
        }
        // It learns the background; with the mutex held, observe() would wait for it.
        if (!observer_) observer_ = std::make_unique<Observer>(*cameras, *background, observing);
        judge_one(std::move(one));
    }
}

void LiveQuality::add_poses(const Observed& one) {
    const auto add = [&](std::uint32_t key, const SubjectResult* result) {
        Subject& subject = subjects_[key];
        subject.poses.push_back({one.result.sequence, result ? result->pose : nullptr});
        if (const auto body = one.bodies.find(key); body != one.bodies.end()) subject.body = body->second;
    };
    if (!options_.several_subjects) add(0, one.result.first_subject());
    if (options_.several_subjects)
        for (const SubjectResult& subject : one.result.subjects) add(subject.track.subject_id, &subject);
    for (auto& [id, subject] : subjects_)
        while (!subject.poses.empty() && subject.poses.front().sequence < observer_->first_sequence())
            subject.poses.pop_front();
    std::erase_if(subjects_, [](const auto& each) { return each.second.poses.empty(); });
}

// As in `kinevox process`, those in a tenth of the frame sets or more.
std::vector<PosedSubject> LiveQuality::followed() const {
    std::vector<PosedSubject> out;
    for (const auto& [id, subject] : subjects_)
        if (10 * subject.poses.size() >= options_.samples)
            out.push_back(
                {id, {subject.poses.begin(), subject.poses.end()}, subject.body ? &*subject.body : nullptr});
    return out;
}

void LiveQuality::judge_one(std::unique_ptr<Observed> one) {
    if (one->result.frame_set.images.empty()) return;
    observer_->add(one->result);
    add_poses(*one);
    if (++since_judged_ < options_.judge_after) return;
    since_judged_ = 0;
    const std::vector<Measurements> subjects = observer_->measure(followed(), options_.subjects_selected);
    const Measurements& seen = subjects.front();
    const bool empty_room =
        seen.pose.subject_fraction == 0 &&
        std::ranges::none_of(seen.cameras, [](const auto& camera) { return camera.seen_fraction > 0.5; });
    std::shared_ptr<const QualityReport> report;
    if (!empty_room) report = std::make_shared<const QualityReport>(judge_worst(subjects));
    const std::scoped_lock lock(mutex_);
    if (!restart_) report_ = std::move(report);
}

}  // namespace kinevox::quality
