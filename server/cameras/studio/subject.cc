#include "server/cameras/studio/subject.h"

#include "server/cameras/studio/hash_noise.h"

namespace kinevox::studio {
namespace {

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

}  // namespace

Subject make_subject(std::uint32_t seed, double stature_m) {
    const auto draw = [seed](std::uint32_t what) { return static_cast<double>(hash_unit(seed, what, 77)); };
    Subject s;
    s.seed = seed;
    s.femininity = draw(1) < 0.5 ? 0.0 : 0.7 + 0.3 * draw(2);
    s.stature_m = stature_m > 0 ? stature_m : 1.79 - 0.12 * s.femininity + 0.14 * (draw(3) - 0.5);
    s.girth = 0.90 + 0.26 * draw(4) * draw(5);
    s.long_hair = s.femininity > 0.5;
    s.shorts = draw(6) < 0.35;
    s.long_sleeves = draw(7) < 0.2;
    const Outfit& outfit = kOutfits[hash_u32(seed, 8) % kOutfits.size()];
    s.pattern = outfit.pattern;
    s.shirt_a = outfit.shirt_a;
    s.shirt_b = outfit.shirt_b;
    s.trousers = outfit.trousers;
    s.shoes = outfit.shoes;
    s.soles = outfit.soles;
    s.skin = kSkins[hash_u32(seed, 9) % kSkins.size()];
    s.hair = kHairs[hash_u32(seed, 10) % kHairs.size()];
    return s;
}

}  // namespace kinevox::studio
