// Skin, hair and the patterns of the clothes, in rest pose coordinates.
#include <algorithm>
#include <cmath>

#include "server/cameras/studio/body_mesh.h"
#include "server/cameras/studio/hash_noise.h"

namespace kinevox::studio {
namespace {

bool on_arm(Bone bone) {
    for (Side side : kSides)
        for (Bone left : {kUpperArmL, kForearmL, kHandL, kShoulderHelpL, kElbowHelpL})
            if (bone == on_side(left, side)) return true;
    return false;
}

// Metres up or along the sleeve (up) and around (around).
struct ClothPlace {
    float up, around;
};
ClothPlace cloth_place(const ImplicitBody& body, Vec3f rest, Bone nearest) {
    if (!on_arm(nearest)) return {rest.z, 0.15f * std::atan2(rest.y, rest.x + 1e-6f)};
    const Vec3f q = body.in_flesh(rest, rest.y > 0 ? kUpperArmL : kUpperArmR);
    return {q.z, 0.06f * std::atan2(q.y, q.x + 1e-6f)};
}

Albedo shirt(const Subject& s, ClothPlace at) {
    const auto period = [](float x, float length) { return x / length - std::floor(x / length); };
    switch (s.pattern) {
        case ShirtPattern::kStripes:
            return period(at.up, 0.075f) < 0.5f ? s.shirt_a : s.shirt_b;
        case ShirtPattern::kDots: {
            const float row = std::floor(at.up / 0.07f);
            const float x = period(at.around + 0.035f * std::fmod(std::abs(row), 2.0f), 0.07f) - 0.5f;
            const float y = period(at.up, 0.07f) - 0.5f;
            return x * x + y * y < 0.075f ? s.shirt_b : s.shirt_a;
        }
        case ShirtPattern::kChecks: {
            const float a = period(at.up, 0.06f) < 0.5f ? 0.5f : 0.0f,
                        b = period(at.around, 0.06f) < 0.5f ? 0.5f : 0.0f;
            return mix(s.shirt_a, s.shirt_b, 0.75f * (a + b) + 0.05f);
        }
        case ShirtPattern::kTwoTone:
            return period(at.up + 0.05f, 0.52f) < 0.28f ? s.shirt_b : s.shirt_a;
        case ShirtPattern::kPlain:
            break;
    }
    return s.shirt_a;
}

}  // namespace

Albedo paint(const ImplicitBody& body, const Subject& s, Vec3f rest, Bone nearest) {
    const Material material = body.material(rest, nearest);
    const ClothPlace at = cloth_place(body, rest, nearest);
    // Folds and weave as brightness: slow across, quick along.
    const auto grain = [&s](float factor) {
        return s.cloth_grain == 1 ? factor : 1 + static_cast<float>(s.cloth_grain) * (factor - 1);
    };
    const float folds =
        0.80f + 0.40f * fractal_noise(9.0f * at.around + 3.0f, 16.0f * rest.z + 8.0f * rest.x, s.seed + 3);
    const float weave = 0.95f + 0.10f * smooth_noise(400.0f * (rest.y + rest.x), 400.0f * rest.z, s.seed + 4);
    const float blotch = 0.92f + 0.16f * fractal_noise(25.0f * (rest.y + rest.x), 25.0f * rest.z, s.seed + 5);
    switch (material) {
        case Material::kSkin:
            return times(s.skin, blotch);
        case Material::kHair:
            return times(s.hair, 0.6f + 0.8f * smooth_noise(120.0f * rest.y, 18.0f * rest.z + 30.0f * rest.x,
                                                            s.seed + 6));
        case Material::kShirt:
            return times(shirt(s, at), grain(folds * weave));
        case Material::kTrousers: {
            const float seam = std::abs(rest.x + 0.01f) < 0.003f ? 0.75f : 1.0f;
            return times(s.trousers, grain(folds * weave * seam));
        }
        case Material::kShoe: {
            const bool stripe =
                std::abs(std::fmod(std::abs(rest.x * 40.0f + rest.z * 25.0f), 3.0f) - 1.0f) < 0.25f;
            return stripe && rest.x > 0 ? s.soles : s.shoes;
        }
        case Material::kSole:
            return s.soles;
        case Material::kSock:
            return {0.62f, 0.62f, 0.62f};
        case Material::kEye:
            return mix({0.07f, 0.05f, 0.04f}, s.skin, 0.3f);
        case Material::kBrow:
            return mix(s.hair, s.skin, 0.35f);
        case Material::kLips:
            return {0.8f * s.skin.r, 0.55f * s.skin.g, 0.55f * s.skin.b};
    }
    return s.skin;
}

}  // namespace kinevox::studio
