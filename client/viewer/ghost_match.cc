#include "client/viewer/ghost_match.h"

#include <utility>

#include "common/body_pose.h"

namespace kinevox::viewer {
namespace {

std::optional<double> event_s(TrialEvent event, const GhostTrial* trial,
                              const std::optional<double>& mark_s) {
    if (event == TrialEvent::kMark) return mark_s;
    if (trial) return trial->time_of(event);
    return event == TrialEvent::kBegin ? std::optional(0.0) : std::nullopt;  // known without poses
}

}  // namespace

double shown_time_s(const ShownPose& shown, double replay_fps) {
    if (shown.recorded_frame && replay_fps > 0)
        return static_cast<double>(*shown.recorded_frame) / replay_fps;
    return 1e-9 * static_cast<double>(shown.capture_time_ns);  // precise to 0.2 microseconds
}

void GhostMatch::set_ghost(std::shared_ptr<const GhostTrial> trial) {
    ghost_ = std::move(trial);
    ghost_mark_s_.reset();
    offset_s_ = 0;
    find_events();
}

void GhostMatch::set_shown(std::shared_ptr<const GhostTrial> trial) {
    shown_ = std::move(trial);
    shown_mark_s_.reset();
    find_events();
}

void GhostMatch::set_events(TrialEvent ghost, TrialEvent shown) {
    ghost_event_ = ghost;
    shown_event_ = shown;
    find_events();
}

void GhostMatch::mark_ghost(double time_s) {
    ghost_mark_s_ = time_s;
    find_events();
}

void GhostMatch::mark_shown(double time_s) {
    shown_mark_s_ = time_s;
    find_events();
}

// Cached, because it searches the whole trial.
void GhostMatch::find_events() {
    ghost_event_s_ = ghost_ ? event_s(ghost_event_, ghost_.get(), ghost_mark_s_) : std::nullopt;
    shown_event_s_ = event_s(shown_event_, shown_.get(), shown_mark_s_);
}

std::optional<double> GhostMatch::ghost_time_s(double shown_time_s) const {
    if (!ghost_event_s_) return {};
    if (!shown_event_s_) return shown_event_ == TrialEvent::kMark ? ghost_event_s_ : std::nullopt;
    return *ghost_event_s_ + (shown_time_s - *shown_event_s_) + offset_s_;
}

ShownPose GhostMatch::pose(const ShownPose& shown, double shown_time_s) const {
    ShownPose pose;
    const auto time_s = ghost_time_s(shown_time_s);
    const auto joints = time_s ? ghost_->at(*time_s) : std::nullopt;
    if (!joints) return pose;
    pose.found = true;
    pose.joints_in_world = *joints;
    const std::size_t root = *joint_index("root");
    const auto &from = (*joints)[root], &to = shown.joints_in_world[root];
    if (align_pelvis_ && from && to)
        for (auto& joint : pose.joints_in_world)
            if (joint) joint = *joint + Vec3{to->x - from->x, to->y - from->y, 0};
    return pose;
}

std::string GhostMatch::problem() const {
    if (!ghost_) return {};
    if (!ghost_event_s_)
        return ghost_event_ == TrialEvent::kMark ? "the ghost has no mark; choose another event"
                                                 : "the ghost has no such event; choose another";
    if (shown_event_s_) return {};
    if (shown_event_ == TrialEvent::kMark) return "press M at the corresponding instant";
    return shown_ ? "the replayed recording has no such event; choose another, or set a mark (M)"
                  : "this event needs a recording with poses; set a mark (M)";
}

}  // namespace kinevox::viewer
