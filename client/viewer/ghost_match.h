// A second trial, drawn as a ghost, and its alignment with the current one in time. No Qt.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/viewer/shown.h"
#include "common/body_table.h"
#include "common/geometry.h"

namespace kinevox::viewer {

using GhostJoints = std::array<std::optional<Vec3>, kJointNames.size()>;  // m, world

struct GhostInstant {
    double time_s = 0;  // since the trial's first frame
    GhostJoints joints_in_world;
};

// Events by which two trials are aligned in time.
enum class TrialEvent { kBegin, kLeftFootDown, kRightFootDown, kHighestPoint, kLowestPoint, kMark };

struct GhostTrial {
    std::string name;
    std::vector<GhostInstant> instants;  // with increasing times

    // The first such event of the trial; empty if there is none. Empty for kMark.
    std::optional<double> time_of(TrialEvent event) const;
    // Interpolated per joint between the two nearest frames; empty before the first and after the last frame.
    std::optional<GhostJoints> at(double time_s) const;
};

// From a table with frame, time_s and the columns of the joints in metres: joints.csv of `kinevox process`
// (root_x) or a CSV export (root_x_m); other columns are ignored. InvalidArgument names the line and the
// error.
absl::StatusOr<GhostTrial> parse_ghost_trial(std::string_view csv, const std::string& name);

// Time of a pose in its own trial: in a replay from the recording's first frame, at its nominal rate; live
// the daemon's time.
double shown_time_s(const ShownPose& shown, double replay_fps);

// Aligns a second trial with the current one in time, by a chosen event of each.
class GhostMatch {
  public:
    // Null: none. Resets its mark and the offset.
    void set_ghost(std::shared_ptr<const GhostTrial> trial);
    const GhostTrial* ghost() const { return ghost_.get(); }
    // The current trial, if it is a replayed recording. Null: live, or unknown. Resets its mark.
    void set_shown(std::shared_ptr<const GhostTrial> trial);

    void set_events(TrialEvent ghost, TrialEvent shown);
    void mark_ghost(double time_s);
    void mark_shown(double time_s);
    std::optional<double> shown_mark_s() const { return shown_mark_s_; }
    // Time by which the ghost is ahead.
    void set_offset_s(double seconds) { offset_s_ = seconds; }
    // Moves the ghost along the floor to the position of the current pelvis.
    void set_align_pelvis(bool on) { align_pelvis_ = on; }

    std::optional<double> ghost_event_s() const { return ghost_event_s_; }
    std::optional<double> shown_event_s() const { return shown_event_s_; }
    // The ghost's time for a time of the current trial. Before the current trial is marked, the time of the
    // ghost's event. Empty without a ghost, or if one of the two lacks the event.
    std::optional<double> ghost_time_s(double shown_time_s) const;
    // The ghost to draw; without joints if there is none.
    ShownPose pose(const ShownPose& shown, double shown_time_s) const;
    // Why no ghost is visible, with the remedy; empty: no problem.
    std::string problem() const;

  private:
    void find_events();

    std::shared_ptr<const GhostTrial> ghost_, shown_;
    TrialEvent ghost_event_ = TrialEvent::kBegin, shown_event_ = TrialEvent::kBegin;
    std::optional<double> ghost_mark_s_, shown_mark_s_;
    std::optional<double> ghost_event_s_, shown_event_s_ = 0;  // times of the events
    double offset_s_ = 0;
    bool align_pelvis_ = false;
};

}  // namespace kinevox::viewer
