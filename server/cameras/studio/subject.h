// The person of the virtual studio: body measurements and clothes, drawn from a seed.
#pragma once

#include <array>
#include <cstdint>

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
};

// The same seed gives the same person. stature_m: 1.2 .. 2.2 m, or 0 for a random one.
Subject make_subject(std::uint32_t seed, double stature_m);

}  // namespace kinevox::studio
