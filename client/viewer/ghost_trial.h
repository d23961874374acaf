// A second trial's skeleton, to be laid over what is shown, and the moments of it that can be laid on one
// another. No Qt.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/geometry.h"
#include "common/skeleton.h"

namespace kinevox::viewer {

using GhostJoints = std::array<std::optional<Vec3>, kJointNames.size()>;  // m, world

struct GhostInstant {
    double time_s = 0;  // since the trial's first frame
    GhostJoints joints_in_world;
};

// The moment at which two trials are the same.
enum class TrialEvent { kBegin, kLeftFootDown, kRightFootDown, kHighest, kLowest, kMark };

struct GhostTrial {
    std::string name;
    std::vector<GhostInstant> instants;  // times rise

    // The first of its kind after the trial's begin; nothing where the trial has none. kMark is nobody's
    // here.
    std::optional<double> time_of(TrialEvent event) const;
    // Between the two nearest frames, joint by joint; nothing before the first frame and behind the last.
    std::optional<GhostJoints> at(double time_s) const;
};

// From a table with frame, time_s and the joints' columns, in metres: joints.csv of `kinevox process`
// (root_x) or a recording's CSV export (root_x_m); other columns are left out. InvalidArgument names the line
// and what is wrong.
absl::StatusOr<GhostTrial> parse_ghost_trial(std::string_view csv, const std::string& name);

}  // namespace kinevox::viewer
