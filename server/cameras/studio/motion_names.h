// The motions of the virtual studio (motion.h), for command lines and configurations.
#pragma once

#include <array>
#include <string_view>

namespace kinevox::studio {

inline constexpr std::array<std::string_view, 11> kMotionNames{
    "walk",  "run",  "sprint_start", "squat", "jumping_jack", "arm_raise",
    "stand", "jump", "punch",        "kick",  "get_up"};

}  // namespace kinevox::studio
