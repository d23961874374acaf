#include "server/cameras/studio/rig.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/cameras/studio/hash_noise.h"

namespace kinevox::studio {
namespace {

constexpr std::array<Bone, 4> kHelped{kUpperArmL, kForearmL, kThighL, kShankL};
constexpr std::array<Bone, 4> kHelpers{kShoulderHelpL, kElbowHelpL, kHipHelpL, kKneeHelpL};

constexpr std::array<Albedo, 5> kSkins{{{0.60f, 0.37f, 0.26f},
                                        {0.50f, 0.29f, 0.19f},
                                        {0.34f, 0.18f, 0.11f},
                                        {0.17f, 0.085f, 0.05f},
                                        {0.66f, 0.43f, 0.33f}}};
constexpr std::array<Albedo, 5> kHairs{{{0.025f, 0.018f, 0.014f},
                                        {0.07f, 0.035f, 0.018f},
                                        {0.30f, 0.18f, 0.07f},
                                        {0.14f, 0.06f, 0.03f},
                                        {0.25f, 0.24f, 0.23f}}};
struct Outfit {
    ShirtPattern pattern;
    Albedo shirt_a, shirt_b, trousers, shoes, soles;
};
constexpr Albedo kWhite{0.72f, 0.72f, 0.70f}, kBlack{0.025f, 0.025f, 0.028f};
constexpr std::array<Outfit, 6> kOutfits{{
    {ShirtPattern::kStripes, {0.50f, 0.045f, 0.04f}, kWhite, {0.030f, 0.050f, 0.13f}, kBlack, kWhite},
    {ShirtPattern::kTwoTone,
     {0.03f, 0.24f, 0.30f},
     {0.60f, 0.56f, 0.10f},
     {0.06f, 0.06f, 0.065f},
     {0.55f, 0.10f, 0.05f},
     kWhite},
    {ShirtPattern::kDots,
     kWhite,
     {0.04f, 0.05f, 0.16f},
     {0.21f, 0.15f, 0.085f},
     {0.06f, 0.09f, 0.35f},
     kWhite},
    {ShirtPattern::kChecks,
     {0.05f, 0.20f, 0.12f},
     {0.35f, 0.33f, 0.24f},
     {0.10f, 0.11f, 0.13f},
     kWhite,
     {0.3f, 0.3f, 0.3f}},
    {ShirtPattern::kPlain,
     {0.55f, 0.26f, 0.03f},
     {0.55f, 0.26f, 0.03f},
     {0.035f, 0.04f, 0.05f},
     kWhite,
     kBlack},
    {ShirtPattern::kStripes,
     {0.10f, 0.12f, 0.32f},
     {0.45f, 0.48f, 0.55f},
     {0.30f, 0.28f, 0.25f},
     kBlack,
     {0.5f, 0.5f, 0.5f}},
}};

// Rotation whose z axis points along -down and whose y axis is nearest to `left`.
Mat3 limb_frame(Vec3 down, Vec3 left) {
    const Vec3 z = -normalized(down);
    const Vec3 y = normalized(left - dot(left, z) * z);
    const Vec3 x = cross(y, z);
    return {{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}};
}

// The rotation of a bone whose end, at `end_in_bone`, lies along a limb_frame().
Mat3 aimed(const Mat3& world_from_limb, Vec3 end_in_bone) {
    return world_from_limb * limb_frame(end_in_bone, {0, 1, 0}).transposed();
}

struct TwoBone {
    Mat3 upper, lower;  // limb_frame()s
    double miss;
};

// Law of cosines; the middle joint moves to the side of `towards`. `hinge_sign` +1: y is the hinge's axis
// with the middle joint in front (knee), -1: behind (elbow).
TwoBone two_bone(Vec3 start, Vec3 target, double upper, double lower, Vec3 towards, double hinge_sign) {
    Vec3 offset = target - start;
    const double wanted = norm(offset);
    const Vec3 along = wanted > 1e-9 ? offset / wanted : Vec3{0, 0, -1};
    const double d = std::clamp(wanted, std::abs(upper - lower) + 1e-3, 0.9995 * (upper + lower));
    const double c = std::clamp((upper * upper + d * d - lower * lower) / (2 * upper * d), -1.0, 1.0);
    Vec3 side = towards - dot(towards, along) * along;
    side = norm(side) > 1e-9 ? normalized(side) : Vec3{1, 0, 0};
    const Vec3 middle = start + upper * c * along + upper * std::sqrt(1 - c * c) * side;
    const Vec3 end = start + d * along;
    const Vec3 left = hinge_sign * cross(side, along);
    return {limb_frame(middle - start, left), limb_frame(end - middle, left), std::abs(wanted - d)};
}

}  // namespace

std::string SubjectOptions::check() const {
    const auto outside = [](double v, double low, double high) { return !(v >= low && v <= high); };
    if (girth && outside(*girth, 0.75, 1.4))
        return fmt::format("girth is {}; it must be 0.75 .. 1.4", *girth);
    if (femininity && outside(*femininity, 0, 1))
        return fmt::format("femininity is {}; it must be 0 .. 1", *femininity);
    for (const double scale : {leg_scale, arm_scale, shoulder_scale, hip_scale})
        if (outside(scale, 0.85, 1.15))
            return fmt::format("a body scale is {}; it must be 0.85 .. 1.15", scale);
    if (outside(belly, 0, 1)) return fmt::format("belly is {}; it must be 0 .. 1", belly);
    if (outside(cloth_grain, 0, 2)) return fmt::format("cloth_grain is {}; it must be 0 .. 2", cloth_grain);
    if (outside(looseness, 0, 3)) return fmt::format("looseness is {}; it must be 0 .. 3", looseness);
    return {};
}

Subject make_subject(std::uint32_t seed, double stature_m, const SubjectOptions& options) {
    const auto draw = [seed](std::uint32_t what) { return static_cast<double>(hash_unit(seed, what, 77)); };
    Subject s;
    s.seed = seed;
    s.femininity = options.femininity.value_or(draw(1) < 0.5 ? 0.0 : 0.7 + 0.3 * draw(2));
    s.stature_m = stature_m > 0 ? stature_m : 1.79 - 0.12 * s.femininity + 0.14 * (draw(3) - 0.5);
    s.girth = options.girth.value_or(0.90 + 0.26 * draw(4) * draw(5));
    s.long_hair = options.long_hair.value_or(s.femininity > 0.5);
    s.shorts = options.shorts.value_or(draw(6) < 0.35);
    s.long_sleeves = options.long_sleeves.value_or(draw(7) < 0.2);
    const Outfit& outfit = kOutfits[hash_u32(seed, 8) % kOutfits.size()];
    s.pattern = options.pattern.value_or(outfit.pattern);
    s.shirt_a = options.shirt_a.value_or(outfit.shirt_a);
    s.shirt_b = options.shirt_b.value_or(outfit.shirt_b);
    s.trousers = options.trousers.value_or(outfit.trousers);
    s.shoes = options.shoes.value_or(outfit.shoes);
    s.soles = outfit.soles;
    s.skin = options.skin.value_or(kSkins[hash_u32(seed, 9) % kSkins.size()]);
    s.hair = options.hair.value_or(kHairs[hash_u32(seed, 10) % kHairs.size()]);
    s.leg_scale = options.leg_scale, s.arm_scale = options.arm_scale;
    s.shoulder_scale = options.shoulder_scale, s.hip_scale = options.hip_scale;
    s.belly = options.belly, s.cloth_grain = options.cloth_grain;
    s.looseness = options.looseness;
    return s;
}

Measures make_measures(const Subject& s) {
    const double h = s.stature_m, f = s.femininity;
    Measures m{};
    m.stature = h;
    m.girth = s.girth;
    m.thigh = 0.245 * h * s.leg_scale;
    m.shank = 0.246 * h * s.leg_scale;
    m.ankle_height = 0.046 * h;  // 0.039 and the sole of a shoe
    m.foot_ball_x = 0.078 * h;
    m.foot_heel_x = -0.040 * h;
    m.toe_length = 0.040 * h;
    m.ball_height = 0.014 * h;
    m.upper_arm = 0.176 * h * s.arm_scale;
    m.forearm = 0.150 * h * s.arm_scale;
    m.hand = 0.105 * h;
    m.hip_half_width = 0.0605 * h * s.hip_scale;
    m.shoulder_half_width = (0.1030 - 0.0075 * f) * h * s.shoulder_scale;
    m.root_above_hips = 0.0043 * h;
    m.trunk_scale = (0.3257 - 0.491 * (s.leg_scale - 1)) / 0.3257;
    m.root_to_sacroiliac = 0.0883 * h * m.trunk_scale;
    m.waist_to_thorax = 0.0724 * h * m.trunk_scale;
    m.thorax_to_neck = 0.165 * h * m.trunk_scale;
    m.neck_to_skullbase = 0.047 * h;
    m.skullbase_to_head_top = 0.086 * h;
    return m;
}

Mat3 slerp(const Mat3& a, const Mat3& b, double t) {
    return a * rotation_from_rodrigues(t * rodrigues_from_rotation(a.transposed() * b));
}

Mat3 limb_rotation(Side side, double flexion, double abduction, double external_rotation) {
    const double s = sign_of(side);
    return rotation_y(-flexion) * rotation_x(s * abduction) * rotation_z(s * external_rotation);
}

Bone Rig::parent(Bone bone) {
    constexpr std::array<Bone, 8> kSideParents{kThorax, kClavicleL, kUpperArmL, kForearmL,
                                               kPelvis, kThighL,    kShankL,    kFootL};
    if (bone <= kHead) return static_cast<Bone>(bone == kPelvis ? 0 : bone - 1);
    if (bone < kPosedBoneCount) {
        const int within = (bone - kClavicleL) % kSideStride;
        const Bone left = kSideParents[within];
        return bone >= kClavicleR && left >= kClavicleL ? static_cast<Bone>(left + kSideStride) : left;
    }
    const int within = (bone - kShoulderHelpL) % kHelpStride;
    return parent(on_side(kHelped[within], bone >= kShoulderHelpR ? Side::kRight : Side::kLeft));
}

Rig::Rig(const Subject& subject) : measures_(make_measures(subject)) {
    const Measures& m = measures_;
    const double h = m.stature;
    flesh_in_bone_[kPelvis] = {0.0149 * h, 0, 0.0017 * h};
    flesh_in_bone_[kLumbar] = {0.0266 * h, 0, 0.0074 * h};
    offset_[kLumbar] = {-0.0057 * h, 0, m.root_to_sacroiliac};
    offset_[kThorax] = {flesh_in_bone_[kLumbar].x, 0, m.waist_to_thorax};
    offset_[kNeck] = {-0.012 * h, 0, m.thorax_to_neck};
    offset_[kHead] = {0.012 * h, 0, m.neck_to_skullbase};
    for (Side side : kSides) {
        const double s = sign_of(side);
        const auto on = [side](Bone left) { return on_side(left, side); };
        flesh_in_bone_[on(kForearmL)] = {0.0057 * h, 0, 0};
        flesh_in_bone_[on(kThighL)] = {0.0116 * h, s * -0.0114 * h, 0};
        flesh_in_bone_[on(kShankL)] = {-0.0074 * h, 0, 0};
        flesh_in_bone_[on(kFootL)] = {0, s * 0.0040 * h, 0};
        // Flesh hangs straight down in the zero pose; the line between two joints slants.
        const auto hang = [&](Bone left, double length) {
            const Vec3 d = flesh_in_bone_[parent(on(left))] - flesh_in_bone_[on(left)];
            offset_[on(left)] = {d.x, d.y, -std::sqrt(length * length - d.x * d.x - d.y * d.y)};
        };
        const Vec3 clavicle{0, s * 0.02 * h, m.thorax_to_neck - 0.022 * h};
        // The acromion is at 0.818 of the stature, the joint centre slightly lower.
        const double shoulder_z =
            0.812 * h - (m.standing_root_z() + m.root_to_sacroiliac + m.waist_to_thorax);
        offset_[on(kClavicleL)] = clavicle;
        offset_[on(kUpperArmL)] = Vec3{-0.006 * h, s * m.shoulder_half_width, shoulder_z} - clavicle;
        hang(kForearmL, m.upper_arm);
        hang(kHandL, m.forearm);
        offset_[on(kThighL)] = {-0.0057 * h, s * m.hip_half_width, -m.root_above_hips};
        hang(kShankL, m.thigh);
        hang(kFootL, m.shank);
        offset_[on(kToesL)] = {m.foot_ball_x, flesh_in_bone_[on(kFootL)].y, m.ball_height - m.ankle_height};
        for (std::size_t i = 0; i < kHelpers.size(); ++i) {
            offset_[on(kHelpers[i])] = offset_[on(kHelped[i])];
            flesh_in_bone_[on(kHelpers[i])] = flesh_in_bone_[on(kHelped[i])];
        }
    }
}

PosedRig Rig::forward(const Pose& pose) const {
    PosedRig out;
    out.world_from_bone[kPelvis] = {pose[kPelvis], pose.root_in_world};
    for (int i = kPelvis + 1; i < kPosedBoneCount; ++i) {
        const auto bone = static_cast<Bone>(i);
        out.world_from_bone[i] = out.world_from_bone[parent(bone)] * Rigid3{pose[bone], offset_[i]};
    }
    for (Side side : kSides) {
        for (int i = 0; i < 4; ++i) {
            const Bone helper = on_side(kHelpers[i], side), helped = on_side(kHelped[i], side);
            out.world_from_bone[helper] = out.world_from_bone[parent(helper)] *
                                          Rigid3{slerp(Mat3{}, pose[helped], 0.5), offset_[helper]};
        }
    }
    return out;
}

std::array<Vec3, kJointNames.size()> Rig::joints(const PosedRig& posed) const {
    std::array<Vec3, kJointNames.size()> out{};
    const auto at = [&](Bone bone, Vec3 in_bone) { return posed.world_from_bone[bone] * in_bone; };
    out[0] = posed.joint(kPelvis);
    out[1] = posed.joint(kLumbar);
    out[2] = posed.joint(kHead);
    out[3] = at(kHead, {0.003 * measures_.stature, 0, measures_.skullbase_to_head_top});
    for (Side side : kSides) {
        const int base = side == Side::kLeft ? 4 : 12;
        out[base + 0] = posed.joint(on_side(kUpperArmL, side));
        out[base + 1] = posed.joint(on_side(kForearmL, side));
        out[base + 2] = posed.joint(on_side(kHandL, side));
        out[base + 3] = at(on_side(kHandL, side), {0, 0, -measures_.hand});
        out[base + 4] = posed.joint(on_side(kThighL, side));
        out[base + 5] = posed.joint(on_side(kShankL, side));
        out[base + 6] = posed.joint(on_side(kFootL, side));
        // The toe ends a little before the shoe.
        out[base + 7] = at(on_side(kToesL, side), {measures_.toe_length - 0.006 * measures_.stature, 0, 0});
    }
    return out;
}

double Rig::place_leg(Pose& pose, Side side, Vec3 ankle_in_world, const Mat3& world_from_foot,
                      Vec3 forward_in_world) const {
    const Bone thigh = on_side(kThighL, side), shank = on_side(kShankL, side), foot = on_side(kFootL, side);
    const Mat3 world_from_pelvis = pose[kPelvis];
    const Vec3 hip = pose.root_in_world + world_from_pelvis * offset_[thigh];
    // x forward cross -z down = y left.
    const TwoBone leg =
        two_bone(hip, ankle_in_world, measures_.thigh, measures_.shank, forward_in_world, 1.0);
    const Mat3 world_from_thigh = aimed(leg.upper, offset_[shank]),
               world_from_shank = aimed(leg.lower, offset_[foot]);
    pose[thigh] = world_from_pelvis.transposed() * world_from_thigh;
    pose[shank] = world_from_thigh.transposed() * world_from_shank;
    pose[foot] = world_from_shank.transposed() * world_from_foot;
    return leg.miss;
}

double Rig::place_arm(Pose& pose, Side side, Vec3 wrist_in_world, const Mat3& world_from_hand,
                      Vec3 elbow_towards_in_world) const {
    const Bone upper = on_side(kUpperArmL, side), fore = on_side(kForearmL, side),
               hand = on_side(kHandL, side);
    const PosedRig posed = forward(pose);
    const TwoBone arm = two_bone(posed.joint(upper), wrist_in_world, measures_.upper_arm, measures_.forearm,
                                 elbow_towards_in_world, -1.0);
    const Mat3 world_from_upper = aimed(arm.upper, offset_[fore]),
               world_from_fore = aimed(arm.lower, offset_[hand]);
    pose[upper] = posed.world_from_bone[on_side(kClavicleL, side)].rotation.transposed() * world_from_upper;
    pose[fore] = world_from_upper.transposed() * world_from_fore;
    pose[hand] = world_from_fore.transposed() * world_from_hand;
    return arm.miss;
}

Pose Rig::rest_pose() const {
    Pose pose;
    pose.root_in_world = {0, 0, measures_.standing_root_z()};
    for (Side side : kSides) {
        pose[on_side(kUpperArmL, side)] = limb_rotation(side, 0, 0.95, 0);
        pose[on_side(kForearmL, side)] = rotation_y(-0.25);
        pose[on_side(kThighL, side)] = limb_rotation(side, 0, 0.20, 0);
        pose[on_side(kFootL, side)] = limb_rotation(side, 0, -0.20, 0);
    }
    return pose;
}

}  // namespace kinevox::studio
