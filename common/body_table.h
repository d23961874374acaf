// The body: names, orders, parents, axes and limits, by `common/make-body-table` from common/body_table.toml;
// do not edit.
#pragma once

#include <array>
#include <limits>
#include <string_view>

#include "common/geometry.h"

namespace kinevox {

// Order of the columns of joints.csv.
inline constexpr std::array<std::string_view, 20> kJointNames{
    "root",    "sacroiliac", "skullbase", "head_top", "shoulder_l", "elbow_l",    "wrist_l",
    "hand_l",  "hip_l",      "knee_l",    "ankle_l",  "toe_l",      "shoulder_r", "elbow_r",
    "wrist_r", "hand_r",     "hip_r",     "knee_r",   "ankle_r",    "toe_r"};

// What they are, in the same order.
inline constexpr std::array<std::string_view, 20> kJointDescriptions{"centre of the pelvis, at the sacrum",
                                                                     "waist, between lower and upper trunk",
                                                                     "between skull and spine",
                                                                     "top of the head",
                                                                     "left shoulder centre",
                                                                     "left elbow centre",
                                                                     "left wrist centre",
                                                                     "tip of the left middle finger",
                                                                     "left hip centre",
                                                                     "left knee centre",
                                                                     "left ankle centre",
                                                                     "tip of the left second toe",
                                                                     "right shoulder centre",
                                                                     "right elbow centre",
                                                                     "right wrist centre",
                                                                     "tip of the right middle finger",
                                                                     "right hip centre",
                                                                     "right knee centre",
                                                                     "right ankle centre",
                                                                     "tip of the right second toe"};

enum class BodySide { kMiddle, kLeft, kRight };

// A line between two joints, for drawing.
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

// Angles from joint positions (common/body_pose.h), in the order of the columns of angles.csv, there with
// the suffix "_deg"; and their labels, without the side.
inline constexpr std::array<std::string_view, 11> kJointAngleNames{
    "knee_flexion_geometric_l",       "knee_flexion_geometric_r",  "elbow_flexion_geometric_l",
    "elbow_flexion_geometric_r",      "hip_flexion_geometric_l",   "hip_flexion_geometric_r",
    "hip_abduction_geometric_l",      "hip_abduction_geometric_r", "shoulder_elevation_geometric_l",
    "shoulder_elevation_geometric_r", "trunk_lean_geometric"};
inline constexpr std::array<std::string_view, 11> kJointAngleLabels{
    "Knee flexion",       "Knee flexion",       "Elbow flexion", "Elbow flexion",
    "Hip flexion",        "Hip flexion",        "Hip abduction", "Hip abduction",
    "Shoulder elevation", "Shoulder elevation", "Trunk lean"};

// The first degree of freedom of each joint.
enum BodyDof : int {
    kDofRootPosition = 0,
    kDofRootRotation = 3,
    kDofSacroiliac = 6,
    kDofSkullbase = 9,
    kDofHipL = 12,
    kDofKneeL = 15,
    kDofAnkleL = 16,
    kDofShoulderL = 17,
    kDofElbowL = 20,
    kDofWristL = 21,
    kDofHipR = 22,
    kDofKneeR = 25,
    kDofAnkleR = 26,
    kDofShoulderR = 27,
    kDofElbowR = 30,
    kDofWristR = 31
};
inline constexpr int kBodyDofCount = 32;

// m; all others are angles, rad
constexpr bool is_position(int dof) {
    return dof < kDofRootRotation;
}

struct BodyDofInfo {
    std::string_view name;  // as in coordinates.csv, there with the suffix _m or _deg
    double lower, upper;    // limits of movement, rad; infinite for the root
};
// Limits: active ranges of motion of healthy adults with about 10 deg beyond the mean: hip, knee, ankle Roaas
// & Andersson (1982); shoulder, elbow, wrist Boone & Azen (1979); trunk and neck White & Panjabi (1990), the
// trunk's being the sum over the thoracic and lumbar spine, since one joint stands for it.
inline constexpr double kNoLimit = std::numeric_limits<double>::infinity();
inline constexpr std::array<BodyDofInfo, kBodyDofCount> kBodyDofs{
    BodyDofInfo{"pelvis_x", -kNoLimit, kNoLimit},
    BodyDofInfo{"pelvis_y", -kNoLimit, kNoLimit},
    BodyDofInfo{"pelvis_z", -kNoLimit, kNoLimit},
    BodyDofInfo{"pelvic_tilt", -kNoLimit, kNoLimit},
    BodyDofInfo{"pelvic_obliquity", -kNoLimit, kNoLimit},
    BodyDofInfo{"pelvic_rotation", -kNoLimit, kNoLimit},
    BodyDofInfo{"lumbar_extension", radians(-75), radians(35)},
    BodyDofInfo{"lumbar_bending", radians(-40), radians(40)},
    BodyDofInfo{"lumbar_rotation", radians(-45), radians(45)},
    BodyDofInfo{"neck_extension", radians(-60), radians(60)},
    BodyDofInfo{"neck_bending", radians(-45), radians(45)},
    BodyDofInfo{"neck_rotation", radians(-80), radians(80)},
    BodyDofInfo{"hip_flexion_l", radians(-30), radians(130)},
    BodyDofInfo{"hip_adduction_l", radians(-60), radians(35)},
    BodyDofInfo{"hip_rotation_l", radians(-50), radians(45)},
    BodyDofInfo{"knee_angle_l", radians(-5), radians(150)},
    BodyDofInfo{"ankle_angle_l", radians(-55), radians(35)},
    BodyDofInfo{"arm_flex_l", radians(-70), radians(185)},
    BodyDofInfo{"arm_add_l", radians(-185), radians(50)},
    BodyDofInfo{"arm_rot_l", radians(-110), radians(95)},
    BodyDofInfo{"elbow_flex_l", radians(0), radians(150)},
    BodyDofInfo{"wrist_flex_l", radians(-75), radians(80)},
    BodyDofInfo{"hip_flexion_r", radians(-30), radians(130)},
    BodyDofInfo{"hip_adduction_r", radians(-60), radians(35)},
    BodyDofInfo{"hip_rotation_r", radians(-50), radians(45)},
    BodyDofInfo{"knee_angle_r", radians(-5), radians(150)},
    BodyDofInfo{"ankle_angle_r", radians(-55), radians(35)},
    BodyDofInfo{"arm_flex_r", radians(-70), radians(185)},
    BodyDofInfo{"arm_add_r", radians(-185), radians(50)},
    BodyDofInfo{"arm_rot_r", radians(-110), radians(95)},
    BodyDofInfo{"elbow_flex_r", radians(0), radians(150)},
    BodyDofInfo{"wrist_flex_r", radians(-75), radians(80)}};
// Their labels, without the side.
inline constexpr std::array<std::string_view, kBodyDofCount> kBodyDofLabels{
    "Pelvis x",        "Pelvis y",         "Pelvis z",       "Pelvic tilt",     "Pelvic obliquity",
    "Pelvic rotation", "Lumbar extension", "Lumbar bending", "Lumbar rotation", "Neck extension",
    "Neck bending",    "Neck rotation",    "Hip flexion",    "Hip adduction",   "Hip rotation",
    "Knee angle",      "Ankle angle",      "Arm flexion",    "Arm adduction",   "Arm rotation",
    "Elbow flexion",   "Wrist flexion",    "Hip flexion",    "Hip adduction",   "Hip rotation",
    "Knee angle",      "Ankle angle",      "Arm flexion",    "Arm adduction",   "Arm rotation",
    "Elbow flexion",   "Wrist flexion"};

enum BodySegment : int {
    kPelvis,
    kThorax,
    kHead,
    kThighL,
    kShankL,
    kFootL,
    kUpperArmL,
    kForearmL,
    kHandL,
    kThighR,
    kShankR,
    kFootR,
    kUpperArmR,
    kForearmR,
    kHandR,
    kBodySegmentCount
};
inline constexpr std::array<std::string_view, kBodySegmentCount> kBodySegmentNames{
    "pelvis", "thorax",  "head",    "thigh_l", "shank_l",     "foot_l",    "upper_arm_l", "forearm_l",
    "hand_l", "thigh_r", "shank_r", "foot_r",  "upper_arm_r", "forearm_r", "hand_r"};
// -1: the world.
inline constexpr std::array<int, kBodySegmentCount> kBodyParent{
    -1,        kPelvis, kThorax, kPelvis, kThighL, kShankL,    kThorax,  kUpperArmL,
    kForearmL, kPelvis, kThighR, kShankR, kThorax, kUpperArmR, kForearmR};
// First degree of freedom of a segment's joint (the pelvis': of its rotation), and their number: 3 or 1.
inline constexpr std::array<int, kBodySegmentCount> kSegmentDof{
    kDofRootRotation, kDofSacroiliac, kDofSkullbase, kDofHipL,   kDofKneeL,
    kDofAnkleL,       kDofShoulderL,  kDofElbowL,    kDofWristL, kDofHipR,
    kDofKneeR,        kDofAnkleR,     kDofShoulderR, kDofElbowR, kDofWristR};
inline constexpr std::array<int, kBodySegmentCount> kSegmentDofCount{3, 3, 3, 3, 1, 1, 3, 1,
                                                                     1, 3, 1, 1, 3, 1, 1};
inline constexpr std::array<BodySide, kBodySegmentCount> kSegmentSide{
    BodySide::kMiddle, BodySide::kMiddle, BodySide::kMiddle, BodySide::kLeft,  BodySide::kLeft,
    BodySide::kLeft,   BodySide::kLeft,   BodySide::kLeft,   BodySide::kLeft,  BodySide::kRight,
    BodySide::kRight,  BodySide::kRight,  BodySide::kRight,  BodySide::kRight, BodySide::kRight};
// Of a hinge: the axis in the parent's frame about which its coordinate is positive; zero for a ball joint.
inline constexpr std::array<std::array<int, 3>, kBodySegmentCount> kSegmentHingeAxis{
    std::array<int, 3>{0, 0, 0}, std::array<int, 3>{0, 0, 0},  std::array<int, 3>{0, 0, 0},
    std::array<int, 3>{0, 0, 0}, std::array<int, 3>{0, 1, 0},  std::array<int, 3>{0, -1, 0},
    std::array<int, 3>{0, 0, 0}, std::array<int, 3>{0, -1, 0}, std::array<int, 3>{-1, 0, 0},
    std::array<int, 3>{0, 0, 0}, std::array<int, 3>{0, 1, 0},  std::array<int, 3>{0, -1, 0},
    std::array<int, 3>{0, 0, 0}, std::array<int, 3>{0, -1, 0}, std::array<int, 3>{1, 0, 0}};
// The joint at a segment's far end, as index of kJointNames: the segment's coordinates are withheld with it.
inline constexpr std::array<int, kBodySegmentCount> kSegmentFarJoint{0, 2,  3,  9,  10, 11, 5, 6,
                                                                     7, 17, 18, 19, 13, 14, 15};
// The segment that carries a joint of kJointNames; of two, the distal one, whose origin it is.
inline constexpr std::array<int, kJointNames.size()> kJointSegment{
    kPelvis, kThorax, kHead,      kHead,     kUpperArmL, kForearmL, kHandL,  kHandL,  kThighL, kShankL,
    kFootL,  kFootL,  kUpperArmR, kForearmR, kHandR,     kHandR,    kThighR, kShankR, kFootR,  kFootR};
// Bones of a VRM humanoid, as the VMC protocol names them.
inline constexpr std::array<std::string_view, kBodySegmentCount> kVmcBoneNames{
    "Hips",          "Spine",        "Head",          "LeftUpperLeg",  "LeftLowerLeg",
    "LeftFoot",      "LeftUpperArm", "LeftLowerArm",  "LeftHand",      "RightUpperLeg",
    "RightLowerLeg", "RightFoot",    "RightUpperArm", "RightLowerArm", "RightHand"};
// The pelvis in MOT files: OpenSim's names, in the order of the file.
inline constexpr std::array<std::string_view, 6> kOpenSimPelvisNames{
    "pelvis_tilt", "pelvis_list", "pelvis_rotation", "pelvis_tx", "pelvis_ty", "pelvis_tz"};

// A node of the hierarchy of BVH files, depth first: a child of the last node above it that is one less deep.
struct BvhNode {
    std::string_view name;
    int segment;  // whose rotation it has; of a clavicle: the upper arm that moves it
    int depth;
    int end_joint;  // index of kJointNames of an end site below it; -1: none
    bool clavicle;
};
inline constexpr std::array kBvhNodes{
    BvhNode{"Hips", kPelvis, 0, -1, false},        BvhNode{"Spine", kThorax, 1, -1, false},
    BvhNode{"Head", kHead, 2, 3, false},           BvhNode{"LeftShoulder", kUpperArmL, 2, -1, true},
    BvhNode{"LeftArm", kUpperArmL, 3, -1, false},  BvhNode{"LeftForeArm", kForearmL, 4, -1, false},
    BvhNode{"LeftHand", kHandL, 5, 7, false},      BvhNode{"RightShoulder", kUpperArmR, 2, -1, true},
    BvhNode{"RightArm", kUpperArmR, 3, -1, false}, BvhNode{"RightForeArm", kForearmR, 4, -1, false},
    BvhNode{"RightHand", kHandR, 5, 15, false},    BvhNode{"LeftUpLeg", kThighL, 1, -1, false},
    BvhNode{"LeftLeg", kShankL, 2, -1, false},     BvhNode{"LeftFoot", kFootL, 3, 11, false},
    BvhNode{"RightUpLeg", kThighR, 1, -1, false},  BvhNode{"RightLeg", kShankR, 2, -1, false},
    BvhNode{"RightFoot", kFootR, 3, 19, false}};

}  // namespace kinevox
