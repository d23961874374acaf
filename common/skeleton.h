// The body's joints and the angles that are reported, by name: what files, API and ground truth agree on.
#pragma once

#include <array>
#include <string_view>

namespace kinevox {

// Order of the columns of joints.csv.
inline constexpr std::array<std::string_view, 20> kJointNames{
    "root",       "sacroiliac", "skullbase", "head_top",   "shoulder_l", "elbow_l", "wrist_l",
    "hand_l",     "hip_l",      "knee_l",    "ankle_l",    "toe_l",      "shoulder_r", "elbow_r",
    "wrist_r",    "hand_r",     "hip_r",     "knee_r",     "ankle_r",    "toe_r"};

}  // namespace kinevox
