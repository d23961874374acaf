#include "server/pipeline/tracking/subject_tracker.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "server/pipeline/subject_control.h"
#include "server/pipeline/tracking/elsewhere.h"

namespace kinevox {
namespace {

constexpr double kAlone_s = 1;    // without others until the lone subject is tracked as such again
constexpr double kOutlier_s = 2;  // for which an excluded camera was one while the subject was alone
constexpr int kMinCameras = 2;    // that show another person
constexpr double kMinLookInterval_s = 0.15;

constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::min();

std::int64_t nanoseconds(double seconds) {
    return static_cast<std::int64_t>(std::llround(1e9 * seconds));
}

// Where several are followed, a newcomer must be found soon.
TrackerOptions looking_often(TrackerOptions options) {
    if (options.several_subjects())
        options.full_pass_interval_s = std::min(options.full_pass_interval_s, kMinLookInterval_s);
    return options;
}

}  // namespace

SubjectTracker::SubjectTracker(std::vector<Camera> cameras, double fps, const TrackerOptions& options,
                               SubjectControl& control)
    : cameras_(std::move(cameras)),
      options_(looking_often(options)),
      control_(&control),
      tracker_(cameras_, fps, options_),
      scene_(cameras_, fps, options_, &control),
      alone_(!options.whole_scene()),
      person_outside_ns_(cameras_.size(), 0),
      excluded_since_ns_(cameras_.size(), kNever) {}

void SubjectTracker::reset() {
    tracker_.reset();
    scene_.reset();
    alone_ = !options_.whole_scene();
    others_seen_ = false;
    std::ranges::fill(person_outside_ns_, 0);
    std::ranges::fill(excluded_since_ns_, kNever);
    forget_shape();
}

void SubjectTracker::forget_shape() {
    shape_.bricks.clear();
    state_.reset();
}

// Whether a camera was excluded for longer than a person takes to come into its view.
bool SubjectTracker::is_outlier(std::size_t camera) const {
    const std::int64_t since_ns = excluded_since_ns_[camera];
    return since_ns != kNever && last_alone_ns_ - since_ns > nanoseconds(kOutlier_s);
}

// Whether options and requests allow to track a lone person as such.
bool SubjectTracker::may_be_alone() const {
    return !options_.whole_scene() && control_->requests() == SubjectRequests{};
}

// From the next frame set on, SceneTracker tracks.
void SubjectTracker::separate() {
    alone_ = false;
    scene_.begin(tracker_.last_id());
    const std::optional<TrackedState> subject = tracker_.subject();
    if (!subject) return;
    // Others in its volume have pulled the track.
    const bool known = state_ && state_->id == subject->id;
    scene_.take_over(known ? *state_ : *subject, shape_);
}

// From the next frame set on, Tracker tracks.
void SubjectTracker::follow_alone() {
    alone_ = true;
    others_seen_ = false;
    std::ranges::fill(person_outside_ns_, 0);
    tracker_.take_over(scene_.only_subject(), scene_.last_id());
    forget_shape();
}

std::vector<kernels::SegmentationPrior> SubjectTracker::predict(std::int64_t time_ns) {
    const bool may_be_alone = this->may_be_alone();
    if (!may_be_alone) last_others_ns_ = time_ns;
    if (alone_ && (others_seen_ || !may_be_alone)) {
        separate();
    } else if (!alone_ && may_be_alone && !others_seen_ &&
               time_ns - last_others_ns_ > nanoseconds(kAlone_s)) {
        follow_alone();
    }
    if (alone_) {
        last_alone_ns_ = time_ns;
        priors_ = tracker_.predict(time_ns, &motion_);
        // An excluded camera may show a person who comes or passes.
        for (std::size_t c = 0; c < cameras_.size(); ++c)
            if (excluded_since_ns_[c] != kNever && !is_outlier(c))
                for (kernels::SegmentationPrior& prior : priors_) prior.full_pass = true;
    } else {
        priors_ = scene_.predict(time_ns);
    }
    return priors_;
}

Vec3 SubjectTracker::motion(std::uint32_t subject_id) const {
    return alone_ ? motion_ : scene_.motion(subject_id);
}

SceneUpdate SubjectTracker::update(std::uint64_t sequence, std::int64_t time_ns,
                                   const SilhouettesByCamera& silhouettes,
                                   std::span<const kernels::ImageView> images) {
    std::optional<SceneUpdate> update;
    Newcomer newcomer;
    if (alone_ && !tracker_.tracking())
        update = update_first(sequence, time_ns, silhouettes, images, newcomer);
    if (update)
        alone_ = false;
    else if (alone_)
        update = update_alone(sequence, time_ns, silhouettes, images, newcomer);
    else
        update = update_scene(sequence, time_ns, silhouettes, images);
    others_seen_ = !options_.whole_scene() && sees_others(time_ns, silhouettes);
    if (others_seen_) last_others_ns_ = time_ns;
    return *std::move(update);
}

// While no subject is tracked: the several people that are there, who are tracked from now on; empty for one,
// the newcomer, or none.
std::optional<SceneUpdate> SubjectTracker::update_first(std::uint64_t sequence, std::int64_t time_ns,
                                                        const SilhouettesByCamera& silhouettes,
                                                        std::span<const kernels::ImageView> images,
                                                        Newcomer& newcomer) {
    const auto showing =
        std::ranges::count_if(silhouettes, [](const auto* s) { return s && s->sharp_pixels > 0; });
    if (showing < kMinCameras) return std::nullopt;
    scene_.begin(tracker_.last_id());
    scene_.predict(time_ns);
    SceneUpdate update = scene_.update(sequence, time_ns, silhouettes, images);
    if (scene_.people() + scene_.newcomers() >= 2) return update;
    newcomer = scene_.lone_newcomer(time_ns);
    return std::nullopt;
}

SceneUpdate SubjectTracker::update_alone(std::uint64_t sequence, std::int64_t time_ns,
                                         const SilhouettesByCamera& silhouettes,
                                         std::span<const kernels::ImageView> images,
                                         const Newcomer& newcomer) {
    TrackerUpdate tracked = tracker_.update(sequence, time_ns, silhouettes, newcomer);
    SceneUpdate update;
    update.events = std::move(tracked.events);
    for (std::size_t c = 0; c < cameras_.size(); ++c)
        if (tracked.roles[c] != CameraRole::kExcluded)
            excluded_since_ns_[c] = kNever;
        else if (excluded_since_ns_[c] == kNever)
            excluded_since_ns_[c] = time_ns;
    if (tracked.lattice) {
        SilhouettesByCamera used = silhouettes;
        for (std::size_t c = 0; c < cameras_.size(); ++c)
            if (tracked.roles[c] == CameraRole::kExcluded) used[c] = nullptr;
        scene_.observe_lone(*tracker_.subject(), time_ns, used, images);
    }
    if (tracked.subject) {
        tracked.subject->name = control_->name_of(tracked.subject->subject_id);
        update.subjects.push_back({*tracked.subject, tracked.lattice, std::move(tracked.roles)});
    }
    publish(update);
    return update;
}

// A camera that was an outlier before others came is one still.
SceneUpdate SubjectTracker::update_scene(std::uint64_t sequence, std::int64_t time_ns,
                                         const SilhouettesByCamera& silhouettes,
                                         std::span<const kernels::ImageView> images) {
    SilhouettesByCamera used = silhouettes;
    for (std::size_t c = 0; c < cameras_.size(); ++c)
        if (is_outlier(c)) used[c] = nullptr;
    SceneUpdate update = scene_.update(sequence, time_ns, used, images);
    for (SceneSubject& subject : update.subjects)
        for (std::size_t c = 0; c < cameras_.size(); ++c)
            if (is_outlier(c) && silhouettes[c]) subject.roles[c] = CameraRole::kExcluded;
    return update;
}

// Whether others are tracked, or several cameras whose whole images were searched show a person beside the
// subject.
bool SubjectTracker::sees_others(std::int64_t time_ns, const SilhouettesByCamera& silhouettes) {
    if (!alone_ && scene_.people() + scene_.newcomers() > 1) return true;
    const std::optional<TrackedState> subject = alone_ ? tracker_.subject() : scene_.only_subject();
    if (!subject) return false;
    const double margin = options_.region_margin_m;
    const Vec3 wide{margin, margin, margin};
    const double look_interval_s = std::max(options_.full_pass_interval_s, kMinLookInterval_s);
    int showing = 0;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (!silhouettes[c] || is_outlier(c)) continue;
        const bool whole = priors_[c].full_pass || priors_[c].region.empty();
        std::int64_t& last = person_outside_ns_[c];
        if (whole) {
            const kernels::Rect box = projected_box(cameras_[c], {subject->box_in_world.min_in_world - wide,
                                                                  subject->box_in_world.max_in_world + wide});
            last = shows_person_outside(cameras_[c], *silhouettes[c], box) ? time_ns : 0;
        }
        showing += last != 0 && time_ns - last <= nanoseconds(1.5 * look_interval_s);
    }
    return showing >= kMinCameras;
}

void SubjectTracker::restrict_to(std::uint32_t subject_id, kernels::VoxelVolume& volume) const {
    if (!alone_) scene_.restrict_to(subject_id, volume);
}

void SubjectTracker::observe_volume(Vec3 centre_in_world, bool legs_missing,
                                    const kernels::VoxelVolume& shape) {
    if (!alone_) return;
    tracker_.observe_volume(centre_in_world, legs_missing);
    const std::optional<TrackedState> subject = tracker_.subject();
    if (state_ && (!subject || state_->id != subject->id)) forget_shape();
    if (scene_.holds_several(shape, shape_)) {
        others_seen_ = true;
        last_others_ns_ = last_alone_ns_;
    } else {
        shape_ = shape;
        state_ = subject;
    }
}

// Reports the lone subject to the operator.
void SubjectTracker::publish(const SceneUpdate& update) const {
    std::vector<KnownSubject> known = scene_.absent_subjects(last_alone_ns_);
    for (const SceneSubject& subject : update.subjects) {
        const std::uint32_t id = subject.track.subject_id;
        std::erase_if(known, [&](const KnownSubject& each) { return each.id == id; });
        known.push_back({id, "", true, Followed::kYes, subject.track.centre_in_world,
                         tracker_.subject()->box_in_world.max_in_world.z, 0});
    }
    std::ranges::sort(known, {}, &KnownSubject::id);
    control_->publish(std::move(known));
}

}  // namespace kinevox
