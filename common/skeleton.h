// The body's joints and the angles that are reported, by name: what files, API and ground truth agree on.
#pragma once

#include <array>
#include <string_view>

namespace kinevox {

// Order of the columns of joints.csv.
inline constexpr std::array<std::string_view, 20> kJointNames{
    "root",    "sacroiliac", "skullbase", "head_top", "shoulder_l", "elbow_l",    "wrist_l",
    "hand_l",  "hip_l",      "knee_l",    "ankle_l",  "toe_l",      "shoulder_r", "elbow_r",
    "wrist_r", "hand_r",     "hip_r",     "knee_r",   "ankle_r",    "toe_r"};

enum class BodySide { kMiddle, kLeft, kRight };

// A line between two joints, for people to look at.
struct Bone {
    std::string_view from, to;
    BodySide side;
};
inline constexpr std::array kBones{
    Bone{"root", "sacroiliac", BodySide::kMiddle},    Bone{"sacroiliac", "skullbase", BodySide::kMiddle},
    Bone{"skullbase", "head_top", BodySide::kMiddle}, Bone{"shoulder_l", "shoulder_r", BodySide::kMiddle},
    Bone{"hip_l", "hip_r", BodySide::kMiddle},        Bone{"shoulder_l", "elbow_l", BodySide::kLeft},
    Bone{"elbow_l", "wrist_l", BodySide::kLeft},      Bone{"wrist_l", "hand_l", BodySide::kLeft},
    Bone{"hip_l", "knee_l", BodySide::kLeft},         Bone{"knee_l", "ankle_l", BodySide::kLeft},
    Bone{"ankle_l", "toe_l", BodySide::kLeft},        Bone{"shoulder_r", "elbow_r", BodySide::kRight},
    Bone{"elbow_r", "wrist_r", BodySide::kRight},     Bone{"wrist_r", "hand_r", BodySide::kRight},
    Bone{"hip_r", "knee_r", BodySide::kRight},        Bone{"knee_r", "ankle_r", BodySide::kRight},
    Bone{"ankle_r", "toe_r", BodySide::kRight}};

}  // namespace kinevox
