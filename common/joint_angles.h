// Angles of the body from joint positions alone: what angles.csv holds and clients read.
// Definitions: lat = unit(hip_l - hip_r), mh = middle of the hips, up = unit part of (sacroiliac - mh)
// orthogonal to lat, fwd = lat x up, ms = middle of the shoulders.
//   knee_flexion       between (knee - hip) and (ankle - knee), 0 straight; elbow_flexion alike
//   hip_flexion        atan2(u . fwd, -u . up), u = unit(knee - hip): positive with the thigh in front
//   hip_abduction      asin(u . lat), sign turned for the right leg: positive away from the middle
//   shoulder_elevation between (elbow - shoulder) and (mh - ms): 0 with the arm hanging
//   trunk_lean         between (skullbase - root) and the vertical
#pragma once

#include <array>
#include <span>
#include <string_view>

#include "common/geometry.h"
#include "common/skeleton.h"

namespace kinevox {

// Order of the columns of angles.csv, there with the suffix "_deg".
inline constexpr std::array<std::string_view, 11> kJointAngleNames{
    "knee_flexion_l",       "knee_flexion_r",       "elbow_flexion_l", "elbow_flexion_r",
    "hip_flexion_l",        "hip_flexion_r",        "hip_abduction_l", "hip_abduction_r",
    "shoulder_elevation_l", "shoulder_elevation_r", "trunk_lean"};

// World positions in the order of kJointNames, metres, z up. Radians, in the order of kJointAngleNames; NaN
// where a joint that an angle needs is NaN or where two joints that span it coincide.
std::array<double, kJointAngleNames.size()> joint_angles(
    std::span<const Vec3, kJointNames.size()> joints_in_world);

}  // namespace kinevox
