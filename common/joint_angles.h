// Geometric angles: from joint positions alone; angles.csv holds them and clients read them. Model
// coordinates (server/pose/body_model.h) have other names and other definitions. Definitions: lat =
// unit(hip_l - hip_r), mh = midpoint of the hips, up = unit of the component of (sacroiliac - mh) orthogonal
// to lat, fwd = lat x up, ms = midpoint of the shoulders.
//   knee_flexion_geometric       between (knee - hip) and (ankle - knee), 0 straight; elbow_flexion alike
//   hip_flexion_geometric        atan2(u . fwd, -u . up), u = unit(knee - hip): positive with the thigh in
//   front hip_abduction_geometric      asin(u . lat), sign inverted for the right leg: positive away from the
//   midline
//                                (the coordinate hip_adduction is positive towards it)
//   shoulder_elevation_geometric between (elbow - shoulder) and (mh - ms): 0 with the arm hanging
//   trunk_lean_geometric         between (skullbase - root) and the vertical
#pragma once

#include <array>
#include <span>
#include <string_view>

#include "common/body_table.h"
#include "common/geometry.h"

namespace kinevox {

// World positions in the order of kJointNames, metres, z up. Radians, in the order of kJointAngleNames; NaN
// where a joint that an angle needs is NaN or where two joints that span it coincide.
std::array<double, kJointAngleNames.size()> joint_angles(
    std::span<const Vec3, kJointNames.size()> joints_in_world);

}  // namespace kinevox
