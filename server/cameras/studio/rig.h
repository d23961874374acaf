// The person of the virtual studio: body measurements and clothes, drawn from a seed, and the skeleton.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "common/body_table.h"
#include "common/geometry.h"

namespace kinevox::studio {

// Linear (not sRGB) reflectance, 0..1.
struct Albedo {
    float r = 0, g = 0, b = 0;
};
inline Albedo times(Albedo a, float s) {
    return {a.r * s, a.g * s, a.b * s};
}
inline Albedo mix(Albedo a, Albedo b, float t) {
    return {a.r + (b.r - a.r) * t, a.g + (b.g - a.g) * t, a.b + (b.b - a.b) * t};
}

enum class ShirtPattern { kStripes, kDots, kChecks, kPlain, kTwoTone };

struct Subject {
    double stature_m = 1.76;
    double girth = 1.0;       // scales limb and trunk radii; 0.85 slim .. 1.2 heavy
    double femininity = 0.0;  // 0..1: shoulders narrower, hips wider, bust
    bool long_hair = false;
    bool shorts = false;  // else trousers down to the ankle
    bool long_sleeves = false;
    ShirtPattern pattern = ShirtPattern::kStripes;
    Albedo skin, hair, shirt_a, shirt_b, trousers, shoes, soles;
    std::uint32_t seed = 0;
    // Of people of the same stature: longer legs go with a shorter trunk.
    double leg_scale = 1, arm_scale = 1, shoulder_scale = 1, hip_scale = 1;
    double belly = 0;        // 0 flat .. 1 large
    double cloth_grain = 1;  // contrast of folds, weave and seams; 0: plain
    double looseness = 1;    // times the thickness of the clothes
};

// What of the subject is chosen; absent values are drawn from the seed.
struct SubjectOptions {
    std::optional<double> girth;                                             // 0.75 .. 1.4
    std::optional<double> femininity;                                        // 0 .. 1
    double leg_scale = 1, arm_scale = 1, shoulder_scale = 1, hip_scale = 1;  // 0.85 .. 1.15
    double belly = 0;                                                        // 0 .. 1
    double cloth_grain = 1, looseness = 1;                                   // 0 .. 2; 0 .. 3
    std::optional<bool> long_hair, shorts, long_sleeves;
    std::optional<ShirtPattern> pattern;
    std::optional<Albedo> skin, hair, shirt_a, shirt_b, trousers, shoes;

    // Empty when usable, else one sentence.
    std::string check() const;
};

// The same seed and options give the same person. stature_m: 1.2 .. 2.2 m, or 0 for a random one.
Subject make_subject(std::uint32_t seed, double stature_m, const SubjectOptions& options = {});

// The skeleton: bones, measurements, forward and inverse kinematics.
// In the zero pose (all local rotations identity) the person stands upright, arms hanging, and the axes of
// all bones are parallel to the world's: x forward, y left, z up. A bone's origin is its joint. The flesh
// on it has an origin of its own, which puts the joint as deep below the skin as in the MakeHuman rig.

// Centre bones, then eight bones per side, then helpers that rotate half as far as their joint (they preserve
// the volume of a bent knee, which plain linear blend skinning would collapse).
enum Bone : int {
    kPelvis,
    kLumbar,
    kThorax,
    kNeck,
    kHead,
    kClavicleL,
    kUpperArmL,
    kForearmL,
    kHandL,
    kThighL,
    kShankL,
    kFootL,
    kToesL,
    kClavicleR,
    kUpperArmR,
    kForearmR,
    kHandR,
    kThighR,
    kShankR,
    kFootR,
    kToesR,
    kShoulderHelpL,
    kElbowHelpL,
    kHipHelpL,
    kKneeHelpL,
    kShoulderHelpR,
    kElbowHelpR,
    kHipHelpR,
    kKneeHelpR,
    kBoneCount
};
inline constexpr int kPosedBoneCount = kShoulderHelpL;
inline constexpr int kSideStride = kClavicleR - kClavicleL;
inline constexpr int kHelpStride = kShoulderHelpR - kShoulderHelpL;

enum class Side { kLeft, kRight };
inline constexpr std::array<Side, 2> kSides{Side::kLeft, Side::kRight};
inline Bone on_side(Bone left, Side side) {
    if (side == Side::kLeft) return left;
    return static_cast<Bone>(left + (left >= kPosedBoneCount ? kHelpStride : kSideStride));
}
inline double sign_of(Side side) {
    return side == Side::kLeft ? 1.0 : -1.0;
}  // of y at the zero pose

// Lengths in metres. Limbs: distances between joints, from the fractions of stature of Drillis & Contini
// (1966), as in Winter, Biomechanics and Motor Control of Human Movement, table 4.1. Pelvis: the MakeHuman
// rig's.
struct Measures {
    double stature, thigh, shank, ankle_height, foot_ball_x, foot_heel_x, toe_length, ball_height;
    double upper_arm, forearm, hand, hip_half_width, shoulder_half_width;
    double root_above_hips, root_to_sacroiliac, waist_to_thorax, thorax_to_neck, neck_to_skullbase,
        skullbase_to_head_top;
    double girth;        // as Subject::girth
    double trunk_scale;  // 1, unless the legs are long or short for the stature
    double standing_root_z() const { return ankle_height + shank + thigh + root_above_hips; }
    double leg() const { return thigh + shank; }
};
Measures make_measures(const Subject& subject);

struct Pose {
    Vec3 root_in_world;
    std::array<Mat3, kPosedBoneCount> parent_from_bone;  // rotations; the pelvis' parent is the world

    Mat3& operator[](Bone bone) { return parent_from_bone[bone]; }
    const Mat3& operator[](Bone bone) const { return parent_from_bone[bone]; }
};

struct PosedRig {
    std::array<Rigid3, kBoneCount> world_from_bone;
    Vec3 joint(Bone bone) const { return world_from_bone[bone].translation; }
};

class Rig {
  public:
    explicit Rig(const Subject& subject);

    const Measures& measures() const { return measures_; }
    static Bone parent(Bone bone);  // kPelvis for kPelvis
    Vec3 offset_in_parent(Bone bone) const { return offset_[bone]; }
    Vec3 flesh_in_bone(Bone bone) const { return flesh_in_bone_[bone]; }  // origin of the flesh

    PosedRig forward(const Pose& pose) const;

    // World positions in the order of kJointNames.
    std::array<Vec3, kJointNames.size()> joints(const PosedRig& posed) const;

    // Inverse kinematics: moves the ankle to `ankle_in_world` (as close as the leg's length permits), the
    // knee bending towards `forward_in_world`, and rotates the foot to `world_from_foot`. The pelvis and the
    // root must be set; writes parent_from_bone of the leg. Returns the remaining error in metres.
    double place_leg(Pose& pose, Side side, Vec3 ankle_in_world, const Mat3& world_from_foot,
                     Vec3 forward_in_world) const;
    // The same for the arm, with the elbow pointing towards `elbow_towards_in_world`.
    double place_arm(Pose& pose, Side side, Vec3 wrist_in_world, const Mat3& world_from_hand,
                     Vec3 elbow_towards_in_world) const;

    // The pose in which the surface is built: arms and legs spread, so that no parts touch.
    Pose rest_pose() const;

  private:
    Measures measures_;
    std::array<Vec3, kBoneCount> offset_{};  // of a bone's joint in its parent's frame
    std::array<Vec3, kBoneCount> flesh_in_bone_{};
};

Mat3 slerp(const Mat3& a, const Mat3& b, double t);

// Rotation from anatomical angles in radians: flexion forward, abduction away from the midline, external
// rotation about the limb's own axis.
Mat3 limb_rotation(Side side, double flexion, double abduction, double external_rotation);

}  // namespace kinevox::studio
