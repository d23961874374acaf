// The skeleton of a second trial, and the events by which trials are aligned. No Qt.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

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

}  // namespace kinevox::viewer
