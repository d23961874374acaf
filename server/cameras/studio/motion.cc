#include "server/cameras/studio/motion.h"

#include <absl/status/status.h>
#include <fmt/format.h>

namespace kinevox::studio {

Stage natural_stage(std::string_view motion) {
    return motion == "run" || motion == "sprint_start" ? Stage::kLane : Stage::kRoom;
}

absl::StatusOr<std::unique_ptr<Motion>> make_motion(std::string_view name, Stage stage, const Rig& rig) {
    if (name == "walk") return make_gait(false, stage, rig);
    if (name == "run") return make_gait(true, stage, rig);
    if (name == "sprint_start") return make_sprint_start(rig);
    if (name == "squat") return make_squat(rig);
    if (name == "jumping_jack") return make_jumping_jack(rig);
    if (name == "arm_raise") return make_arm_raise(rig);
    return absl::InvalidArgumentError(
        fmt::format("motion '{}' is unknown; there are {}", name, fmt::join(kMotionNames, ", ")));
}

}  // namespace kinevox::studio
