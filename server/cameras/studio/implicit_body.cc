#include "server/cameras/studio/implicit_body.h"

#include <algorithm>
#include <cmath>

#include "server/cameras/studio/hash_noise.h"

namespace kinevox::studio {
namespace {

bool is_foot(Bone bone) {
    return bone == kFootL || bone == kFootR || bone == kToesL || bone == kToesR;
}

Side side_of(Bone bone) {
    if (bone >= kPosedBoneCount) return bone >= kShoulderHelpR ? Side::kRight : Side::kLeft;
    return bone >= kClavicleR ? Side::kRight : Side::kLeft;
}

// Left twin of a bone, itself for the middle ones.
Bone left_twin(Bone bone) {
    if (bone >= kShoulderHelpR) return static_cast<Bone>(bone - kHelpStride);
    if (bone >= kClavicleR && bone < kPosedBoneCount) return static_cast<Bone>(bone - kSideStride);
    return bone;
}

}  // namespace

ImplicitBody::ImplicitBody(const Rig& rig, const Subject& subject)
    : rig_(rig),
      subject_(subject),
      unit_(static_cast<float>(subject.stature_m / 1.8)),
      girth_(static_cast<float>(subject.girth)) {
    const PosedRig rest = rig.forward(rig.rest_pose());
    for (int b = 0; b < kBoneCount; ++b) {
        rest_from_flesh_[b] =
            rest.world_from_bone[b] * Rigid3{Mat3{}, rig.flesh_in_bone(static_cast<Bone>(b))};
        flesh_from_rest_[b] = to_float(rest_from_flesh_[b].inverse());
    }
    lower_ = {10, 10, 10};
    upper_ = {-10, -10, -10};
    add_trunk();
    add_head();
    for (Side side : kSides) add_limbs(side);
    const Vec3f margin{0.03f, 0.03f, 0.03f};
    lower_ = lower_ - margin;
    upper_ = upper_ + margin;
}

// a, b from the origin of the bone's flesh in units of a 1.8 m tall body; radii likewise, times girth except
// on the head.
void ImplicitBody::add(Bone bone, Vec3f a, float ra, Vec3f b, float rb, float flat_x, float flat_y,
                       float blend) {
    const float thick = unit_ * (bone == kHead || is_foot(bone) ? 1.0f : girth_);
    const bool trunk = bone == kPelvis || bone == kLumbar || bone == kThorax;
    const float along = trunk ? static_cast<float>(rig_.measures().trunk_scale) : 1.0f;
    const Vec3f start = unit_ * Vec3f{a.x, a.y, along * a.z}, end = unit_ * Vec3f{b.x, b.y, along * b.z};
    Primitive p;
    p.bone = bone;
    p.ra = thick * ra;
    p.rb = thick * rb;
    p.blend = unit_ * blend;
    p.shrink = std::min({flat_x, flat_y, 1.0f});
    // Squash first, then turn a->b to +z.
    const Vec3f scaled{(end.x - start.x) / flat_x, (end.y - start.y) / flat_y, end.z - start.z};
    p.length = norm(scaled);
    const Vec3f z = p.length > 1e-6f ? (1.0f / p.length) * scaled : Vec3f{0, 0, 1};
    const Vec3f helper = std::abs(z.x) < 0.8f ? Vec3f{1, 0, 0} : Vec3f{0, 1, 0};
    const Vec3f x = normalized(cross(helper, z)), y = cross(z, x);
    const Vec3f rows[3] = {x, y, z};
    const Affine3f& from_rest = flesh_from_rest_[bone];
    for (int r = 0; r < 3; ++r) {
        const Vec3f w{rows[r].x / flat_x, rows[r].y / flat_y, rows[r].z};
        for (int c = 0; c < 4; ++c) {
            p.local_from_rest.m[4 * r + c] =
                w.x * from_rest.m[c] + w.y * from_rest.m[4 + c] + w.z * from_rest.m[8 + c];
        }
        p.local_from_rest.m[4 * r + 3] -= w.x * start.x + w.y * start.y + w.z * start.z;
    }
    const Vec3f a_rest = to_float(rest_from_flesh_[bone] * to_double(start));
    const Vec3f b_rest = to_float(rest_from_flesh_[bone] * to_double(end));
    const float widest = std::max({flat_x, flat_y, 1.0f});
    p.centre = 0.5f * (a_rest + b_rest);
    p.radius = 0.5f * norm(b_rest - a_rest) + widest * std::max(p.ra, p.rb);
    const Vec3f ball{p.radius, p.radius, p.radius};
    const Vec3f low = p.centre - ball, high = p.centre + ball;
    lower_ = {std::min(lower_.x, low.x), std::min(lower_.y, low.y), std::min(lower_.z, low.z)};
    upper_ = {std::max(upper_.x, high.x), std::max(upper_.y, high.y), std::max(upper_.z, high.z)};
    primitives_.push_back(p);
}

void ImplicitBody::add_trunk() {
    const float f = static_cast<float>(subject_.femininity);
    const float waist = 1.0f - 0.12f * f;
    add(kPelvis, {-0.005f, 0, 0.035f}, 0.138f + 0.014f * f, {0.0f, 0, 0.05f}, 0.132f, 0.72f, 1, 0.03f);
    for (float s : {1.0f, -1.0f})
        add(kPelvis, {-0.040f, s * 0.072f, -0.030f}, 0.081f, {-0.035f, s * 0.06f, 0.02f}, 0.075f, 1, 1,
            0.05f);
    add(kLumbar, {0.018f, 0, -0.05f}, 0.133f * waist, {0.008f, 0, 0.07f}, 0.136f * waist, 0.63f, 1, 0.05f);
    add(kLumbar, {0.04f, 0, -0.05f}, 0.075f, {0.035f, 0, 0.05f}, 0.075f, 0.8f, 1.2f, 0.05f);
    if (subject_.belly > 0) {
        const float b = static_cast<float>(subject_.belly);
        add(kLumbar, {0.045f + 0.04f * b, 0, -0.06f}, 0.075f + 0.035f * b, {0.04f + 0.03f * b, 0, 0.02f},
            0.075f + 0.025f * b, 0.9f, 1.3f, 0.06f);
    }
    add(kThorax, {0.0f, 0, 0.01f}, 0.138f - 0.010f * f, {-0.008f, 0, 0.17f}, 0.146f - 0.012f * f, 0.74f, 1,
        0.05f);
    add(kThorax, {-0.025f, 0.115f, 0.205f}, 0.062f, {-0.025f, -0.115f, 0.205f}, 0.062f, 1, 1, 0.06f);
    for (float s : {1.0f, -1.0f}) {
        const float bust = 0.022f * f;
        add(kThorax, {0.045f + 0.6f * bust, s * 0.072f, 0.125f - bust}, 0.062f + 0.2f * bust,
            {0.04f, s * 0.08f, 0.16f}, 0.06f, 0.8f, 1.1f, 0.05f);
        add(kThorax, {-0.022f, s * 0.03f, 0.305f}, 0.038f, {-0.020f, s * 0.125f, 0.224f}, 0.043f, 1, 1,
            0.05f);
        add(kThorax, {-0.055f, s * 0.075f, 0.17f}, 0.065f, {-0.05f, s * 0.065f, 0.06f}, 0.06f, 0.9f, 1.1f,
            0.05f);
    }
    const float neck = 0.056f - 0.008f * f;
    add(kNeck, {-0.008f, 0, -0.03f}, neck + 0.006f, {0.008f, 0, 0.08f}, neck, 1, 1, 0.04f);
}

void ImplicitBody::add_head() {
    add(kHead, {0.000f, 0, 0.060f}, 0.092f, {0.012f, 0, 0.066f}, 0.088f, 1.0f, 0.82f, 0.015f);
    add(kHead, {0.030f, 0, 0.040f}, 0.068f, {0.056f, 0, -0.048f}, 0.036f, 1.0f, 0.92f, 0.03f);
    add(kHead, {0.100f, 0, 0.032f}, 0.010f, {0.110f, 0, 0.004f}, 0.014f, 1.0f, 1.0f, 0.012f);    // nose
    add(kHead, {0.078f, 0, -0.028f}, 0.018f, {0.082f, 0, -0.020f}, 0.016f, 1.0f, 1.4f, 0.012f);  // mouth
    for (float s : {1.0f, -1.0f})
        add(kHead, {-0.006f, s * 0.078f, 0.006f}, 0.013f, {-0.012f, s * 0.082f, 0.036f}, 0.020f, 1, 0.45f,
            0.008f);
    if (subject_.long_hair) {
        add(kHead, {-0.085f, 0, 0.055f}, 0.045f, {-0.125f, 0, 0.035f}, 0.030f, 1, 1, 0.03f);
        add(kHead, {-0.130f, 0, 0.03f}, 0.030f, {-0.140f, 0, -0.10f}, 0.018f, 1, 1.1f, 0.02f);
    }
}

void ImplicitBody::add_limbs(Side side) {
    const Measures& m = rig_.measures();
    const float u = unit_, s = static_cast<float>(sign_of(side));
    const float upper_arm = static_cast<float>(m.upper_arm) / u, forearm = static_cast<float>(m.forearm) / u;
    const float thigh = static_cast<float>(m.thigh) / u, shank = static_cast<float>(m.shank) / u;
    const float ankle = static_cast<float>(m.ankle_height) / u;
    const float f = static_cast<float>(subject_.femininity), arm = 1.0f - 0.12f * f;
    const auto on = [side](Bone left) { return on_side(left, side); };

    add(on(kShoulderHelpL), {0, s * -0.004f, -0.002f}, 0.059f * arm, {0, s * 0.004f, -0.035f}, 0.054f * arm,
        1, 1, 0.05f);
    add(on(kUpperArmL), {0, 0, -0.07f}, 0.050f * arm, {0.008f, 0, -0.6f * upper_arm}, 0.046f * arm, 1, 0.95f,
        0.03f);
    add(on(kUpperArmL), {0, 0, -0.6f * upper_arm}, 0.045f * arm, {0, 0, -0.88f * upper_arm}, 0.040f * arm, 1,
        1, 0.03f);
    add(on(kElbowHelpL), {-0.004f, 0, 0.01f}, 0.041f * arm, {0, 0, -0.01f}, 0.041f * arm, 1, 1, 0.02f);
    add(on(kForearmL), {0, 0, -0.025f}, 0.041f * arm, {0.002f, 0, -0.32f * forearm}, 0.043f * arm, 1, 0.95f,
        0.02f);
    add(on(kForearmL), {0, 0, -0.32f * forearm}, 0.042f * arm, {0, 0, -forearm}, 0.027f * arm, 1, 0.9f,
        0.02f);
    // The palm faces the thigh: thin along y, thumb in front.
    add(on(kHandL), {0, 0, 0.0f}, 0.027f * arm, {0.002f, 0, -0.04f}, 0.040f, 1, 0.52f, 0.015f);
    add(on(kHandL), {0.002f, 0, -0.04f}, 0.042f, {0.000f, 0, -0.085f}, 0.041f, 1, 0.40f, 0.015f);
    add(on(kHandL), {0.0f, 0, -0.09f}, 0.040f, {0.0f, s * -0.003f, -0.168f}, 0.028f, 1, 0.40f, 0.01f);
    add(on(kHandL), {0.026f, s * -0.006f, -0.03f}, 0.017f, {0.056f, s * -0.014f, -0.092f}, 0.012f, 1, 0.9f,
        0.015f);

    const float flesh = 0.96f + 0.08f * f;
    add(on(kHipHelpL), {-0.008f, 0.0f, 0.01f}, 0.092f * flesh, {-0.004f, s * 0.01f, -0.06f}, 0.091f * flesh,
        1, 0.92f, 0.05f);
    add(on(kThighL), {0.0f, s * 0.004f, -0.09f}, 0.089f * flesh, {0.008f, 0, -0.55f * thigh}, 0.073f * flesh,
        1, 0.95f, 0.03f);
    add(on(kThighL), {0.006f, 0, -0.55f * thigh}, 0.073f * flesh, {0.002f, 0, -0.9f * thigh}, 0.057f, 1,
        0.95f, 0.03f);
    add(on(kKneeHelpL), {0.006f, 0, 0.02f}, 0.055f, {0.006f, 0, -0.02f}, 0.053f, 1, 0.95f, 0.025f);
    add(on(kShankL), {-0.006f, 0, -0.05f}, 0.052f, {-0.016f, 0, -0.30f * shank}, 0.056f, 1, 0.93f, 0.025f);
    add(on(kShankL), {-0.016f, 0, -0.30f * shank}, 0.055f, {-0.006f, 0, -0.93f * shank}, 0.034f, 1, 0.93f,
        0.025f);
    add(on(kFootL), {-0.006f, 0, 0.03f}, 0.036f, {-0.004f, 0, -0.01f}, 0.037f, 1, 0.92f, 0.02f);
    add(on(kFootL), {-0.028f, 0, 0.036f - ankle}, 0.040f, {0.01f, 0, 0.04f - ankle}, 0.040f, 1, 0.86f, 0.02f);
    add(on(kFootL), {0.0f, 0, 0.045f - ankle}, 0.044f, {0.115f, s * 0.004f, 0.020f - ankle}, 0.034f, 1, 1.05f,
        0.025f);
    add(on(kFootL), {0.09f, s * 0.003f, 0.016f - ankle}, 0.032f, {0.14f, s * 0.004f, 0.014f - ankle}, 0.030f,
        1, 1.40f, 0.02f);
    add(on(kToesL), {-0.02f, s * 0.003f, 0.0f}, 0.030f, {0.044f, s * -0.004f, -0.006f}, 0.024f, 1, 1.45f,
        0.015f);
}

float ImplicitBody::primitive_distance(const Primitive& primitive, Vec3f rest) {
    const Vec3f q = primitive.local_from_rest.point(rest);
    const float radial = std::sqrt(q.x * q.x + q.y * q.y), l = primitive.length;
    const float dr = primitive.ra - primitive.rb;
    float d;
    if (l <= std::abs(dr) + 1e-6f) {
        d = std::min(std::sqrt(radial * radial + q.z * q.z) - primitive.ra,
                     std::sqrt(radial * radial + (q.z - l) * (q.z - l)) - primitive.rb);
    } else {
        const float b = dr / l, a = std::sqrt(1 - b * b);
        const float k = -b * radial + a * q.z;
        if (k < 0)
            d = std::sqrt(radial * radial + q.z * q.z) - primitive.ra;
        else if (k > a * l)
            d = std::sqrt(radial * radial + (q.z - l) * (q.z - l)) - primitive.rb;
        else
            d = radial * a + q.z * b - primitive.ra;
    }
    return d * primitive.shrink;
}

ImplicitBody::Sample ImplicitBody::sample(Vec3f rest) const {
    float d = 1.0f, nearest_distance = 1.0f;
    Bone nearest = kPelvis;
    for (const Primitive& p : primitives_) {
        const float bound = norm(rest - p.centre) - p.radius;
        if (bound > d + p.blend && bound > nearest_distance) continue;
        const float own = primitive_distance(p, rest);
        if (own < nearest_distance) {
            nearest_distance = own;
            nearest = p.bone;
        }
        const float h = std::max(p.blend - std::abs(d - own), 0.0f);
        d = std::min(d, own) - (h > 0 ? 0.25f * h * h / p.blend : 0.0f);
    }
    d -= static_cast<float>(subject_.looseness) * clothes(rest, nearest);
    if (is_foot(nearest)) {  // flat soles
        const Side side = side_of(nearest);
        const Vec3f in_foot = in_flesh(rest, on_side(kFootL, side));
        d = std::max(d, -static_cast<float>(rig_.measures().ankle_height) - in_foot.z);
    }
    return {d, nearest};
}

void ImplicitBody::bone_distances(Vec3f rest, float (&distance)[kBoneCount]) const {
    std::fill(std::begin(distance), std::end(distance), 1.0f);
    for (const Primitive& p : primitives_)
        distance[p.bone] = std::min(distance[p.bone], primitive_distance(p, rest));
}

Material ImplicitBody::material(Vec3f rest, Bone nearest) const {
    const Measures& m = rig_.measures();
    const Bone twin = left_twin(nearest);
    const auto local = [&](Bone left) { return in_flesh(rest, on_side(left, side_of(nearest))); };
    const float u = unit_;
    switch (twin) {
        case kHead: {
            const Vec3f q = (1.0f / u) * in_flesh(rest, kHead);
            const float hairline =
                0.062f - 0.25f * (q.x - 0.06f) + (q.x < 0.02f ? -0.35f * (0.02f - q.x) : 0.0f);
            const bool nape = q.x < -0.012f && q.z > (subject_.long_hair ? -0.12f : -0.02f);
            if (q.z > 0.098f - 0.10f * std::abs(q.y) || nape || (q.x < 0.045f && q.z > hairline))
                return Material::kHair;
            if (q.x < -0.07f) return Material::kHair;
            if (q.x > 0.05f) {
                const float ey = (std::abs(q.y) - 0.032f) / 0.010f, ez = (q.z - 0.036f) / 0.005f;
                if (ey * ey + ez * ez < 1) return Material::kEye;
                if (std::abs(std::abs(q.y) - 0.034f) < 0.016f && std::abs(q.z - 0.054f) < 0.003f)
                    return Material::kBrow;
                if (std::abs(q.y) < 0.024f && std::abs(q.z + 0.024f) < 0.006f) return Material::kLips;
            }
            return Material::kSkin;
        }
        case kNeck: {
            const Vec3f q = (1.0f / u) * in_flesh(rest, kNeck);
            return q.z < -0.010f - 0.25f * q.x ? Material::kShirt : Material::kSkin;
        }
        case kThorax: {
            const Vec3f q = (1.0f / u) * in_flesh(rest, kNeck);
            const float collar = std::sqrt((q.x + 0.01f) * (q.x + 0.01f) + q.y * q.y);
            return collar < 0.082f && q.z > -0.03f - 0.25f * q.x ? Material::kSkin : Material::kShirt;
        }
        case kLumbar:
        case kClavicleL:
        case kShoulderHelpL:
            return Material::kShirt;
        case kPelvis:
        case kHipHelpL:
            return in_flesh(rest, kPelvis).z > 0.005f * u ? Material::kShirt : Material::kTrousers;
        case kUpperArmL:
        case kElbowHelpL:
        case kForearmL:
        case kHandL: {
            const float along = -local(kUpperArmL).z / static_cast<float>(m.upper_arm);
            if (twin == kUpperArmL && along < 0.62f) return Material::kShirt;
            if (!subject_.long_sleeves || twin == kHandL) return Material::kSkin;
            return -local(kForearmL).z < 0.93f * static_cast<float>(m.forearm) ? Material::kShirt
                                                                               : Material::kSkin;
        }
        case kThighL:
        case kKneeHelpL:
        case kShankL: {
            const float thigh = -local(kThighL).z / static_cast<float>(m.thigh);
            const float shank = -local(kShankL).z / static_cast<float>(m.shank);
            if (subject_.shorts)
                return thigh < 0.72f   ? Material::kTrousers
                       : shank > 0.80f ? Material::kSock
                                       : Material::kSkin;
            return shank < 0.95f ? Material::kTrousers : Material::kSock;
        }
        default: {  // feet
            const float height = static_cast<float>(m.ankle_height) + local(kFootL).z;
            if (height < 0.017f * u) return Material::kSole;
            return height < 0.088f * u ? Material::kShoe : Material::kSock;
        }
    }
}

// Cloth thickness with a hem: it grows towards the edge, then ends.
float ImplicitBody::clothes(Vec3f rest, Bone nearest) const {
    const Measures& m = rig_.measures();
    const Bone twin = left_twin(nearest);
    const auto along = [&](Bone left, double length) {
        return -in_flesh(rest, on_side(left, side_of(nearest))).z / static_cast<float>(length);
    };
    const auto hem = [](float t, float end) {  // 0..1..0
        return (0.55f + 0.45f * smoothstep(end - 0.5f, end, t)) *
               (1.0f - smoothstep(end - 0.005f, end + 0.045f, t));
    };
    switch (twin) {
        case kHead:
            return material(rest, nearest) == Material::kHair ? 0.011f * unit_ : 0.0f;
        case kThorax:
        case kShoulderHelpL:
        case kClavicleL:
            return 0.007f;
        case kLumbar:
            return 0.010f;
        case kPelvis:
        case kHipHelpL: {
            const float z = in_flesh(rest, kPelvis).z / unit_;
            return 0.004f + 0.012f * smoothstep(-0.004f, 0.010f, z);
        }
        case kUpperArmL:
        case kElbowHelpL:
        case kForearmL:
            if (subject_.long_sleeves) {
                const float t = twin == kUpperArmL ? 0.0f : along(kForearmL, m.forearm);
                return 0.012f * hem(t, 0.93f);
            }
            return twin == kUpperArmL ? 0.017f * hem(along(kUpperArmL, m.upper_arm), 0.62f) : 0.0f;
        case kThighL:
        case kKneeHelpL:
        case kShankL:
            if (subject_.shorts) return twin == kThighL ? 0.020f * hem(along(kThighL, m.thigh), 0.72f) : 0.0f;
            return twin == kThighL ? 0.009f : 0.008f + 0.010f * hem(along(kShankL, m.shank), 0.95f);
        default:
            return 0.0f;
    }
}

}  // namespace kinevox::studio
