// Lays a second trial over what is shown, so that a chosen event of each is at the same time. No Qt.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "client/viewer/ghost_trial.h"
#include "client/viewer/shown.h"

namespace kinevox::viewer {

// Where a pose that is shown stands on its own trial's clock: of a replay since the recording's first frame,
// at its nominal rate; live since the daemon's clock began.
double shown_time_s(const ShownPose& shown, double replay_fps);

class GhostMatch {
  public:
    // Null: none. Its mark and the offset are forgotten.
    void set_ghost(std::shared_ptr<const GhostTrial> trial);
    const GhostTrial* ghost() const { return ghost_.get(); }
    // What is shown, as far as it is known beforehand: a replayed recording. Null: live, or not known; its
    // mark is forgotten.
    void set_shown(std::shared_ptr<const GhostTrial> trial);

    void set_events(TrialEvent ghost, TrialEvent shown);
    void mark_ghost(double time_s);
    void mark_shown(double time_s);
    std::optional<double> shown_mark_s() const { return shown_mark_s_; }
    // The ghost is so much ahead.
    void set_offset_s(double seconds) { offset_s_ = seconds; }
    // Moved along the floor so that both pelves are at one place.
    void set_on_pelvis(bool on) { on_pelvis_ = on; }

    std::optional<double> ghost_event_s() const { return ghost_event_s_; }
    std::optional<double> shown_event_s() const { return shown_event_s_; }
    // The ghost's clock at that moment. While what is shown waits for its mark, the ghost stands still at its
    // event. Nothing without a ghost or where one of the two has no such event.
    std::optional<double> ghost_time_s(double shown_time_s) const;
    // To be drawn; without joints where there is nothing.
    ShownPose pose(const ShownPose& shown, double shown_time_s) const;
    // Why there is no ghost to be seen and what to do; empty where nothing is wrong.
    std::string lack() const;

  private:
    void find_events();

    std::shared_ptr<const GhostTrial> ghost_, shown_;
    TrialEvent ghost_event_ = TrialEvent::kBegin, shown_event_ = TrialEvent::kBegin;
    std::optional<double> ghost_mark_s_, shown_mark_s_;
    std::optional<double> ghost_event_s_, shown_event_s_ = 0;  // where the events are
    double offset_s_ = 0;
    bool on_pelvis_ = false;
};

}  // namespace kinevox::viewer
