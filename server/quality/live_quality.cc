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
    cameras_ = std::move(cameras);
    background_ = std::move(background);
    restart_ = true;
    next_.reset();
    report_.reset();
}

void LiveQuality::set_cameras(std::vector<Camera> cameras) {
    const std::scoped_lock lock(mutex_);
    cameras_ = std::move(cameras);
    restart_ = true;
    next_.reset();
    report_.reset();
}

void LiveQuality::observe(const FrameResult& result, const BodyShape* body) {
    {
        const std::scoped_lock lock(mutex_);
        const std::int64_t since = result.capture_time_ns - last_time_ns_;
        if (!background_ || next_ || (since >= 0 && since < options_.sample_interval.count())) return;
        last_time_ns_ = result.capture_time_ns;
        next_ = std::make_unique<Observed>();
        next_->result.sequence = result.sequence;
        next_->result.frame_set = result.frame_set;
        next_->result.subjects = result.subjects;
        if (body) next_->body = *body;
    }
    changed_.notify_all();
}

std::optional<QualityReport> LiveQuality::report() const {
    const std::scoped_lock lock(mutex_);
    return report_;
}

void LiveQuality::work() {
    for (;;) {
        std::unique_ptr<Observed> one;
        {
            std::unique_lock lock(mutex_);
            changed_.wait(lock, [&] { return closing_ || next_; });
            if (closing_) return;
            one = std::move(next_);
            if (std::exchange(restart_, false)) {
                observer_.reset();
                poses_.clear();
                since_judged_ = 0;
            }
            if (!observer_)
                observer_ = std::make_unique<Observer>(
                    cameras_, *background_, ObserverOptions{options_.max_side_px, options_.samples, true});
        }
        judge_one(std::move(one));
    }
}

void LiveQuality::judge_one(std::unique_ptr<Observed> one) {
    if (one->result.frame_set.images.empty()) return;
    observer_->add(one->result);
    const SubjectResult* const subject = one->result.first_subject();
    poses_.push_back({one->result.sequence, subject ? subject->pose : nullptr});
    while (poses_.front().sequence < observer_->first_sequence()) poses_.pop_front();
    if (++since_judged_ < options_.judge_after) return;
    since_judged_ = 0;
    const std::vector<PosedFrame> poses(poses_.begin(), poses_.end());
    const Measurements seen = observer_->measure(poses, one->body ? &*one->body : nullptr);
    const bool empty_room =
        seen.pose.subject_fraction == 0 &&
        std::ranges::none_of(seen.cameras, [](const auto& camera) { return camera.seen_fraction > 0.5; });
    std::optional<QualityReport> report;
    if (!empty_room) report = judge(seen);
    const std::scoped_lock lock(mutex_);
    if (!restart_) report_ = std::move(report);
}

}  // namespace kinevox::quality
