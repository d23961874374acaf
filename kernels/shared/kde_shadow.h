// Subject or shadow: the second look at pixels that differ from the background and that another light could
// explain. A single pixel does not decide it where clothes have the background's chromaticity, so the rule
// also asks its surroundings (does one light explain the whole patch?) and the other cameras: a shadow
// darkens a floor point for every camera, so if any of them sees the point behind this pixel clearly
// brighter, the pixel is the subject. Walls have no floor point; there, and everywhere, the cameras vote on
// the points along the pixel's ray: the subject is somewhere on it only if the others may see it there. A
// logistic rule joins the evidence; its weights are learned from rendered sequences with exact silhouettes
// (tests/accuracy/shadow_rule.py). Pixels lighter than any shadow have a rule of their own: a reflection
// keeps the texture of what it lightens, cloth does not.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "kernels/shared/camera.h"
#include "kernels/shared/device.h"
#include "kernels/shared/kde_density.h"
#include "kernels/shared/kde_evidence.h"
#include "kernels/shared/kde_scene.h"
#include "kernels/shared/shadow_weights.h"

namespace kinevox::kernels::kde {

inline constexpr int kPatchRadius = 3;  // px; one light must explain a patch of 7 x 7
// Brighter pixels are in no shadow. Reflections and windows lighten a background that keeps its texture.
inline constexpr float kBrightestShadow = 1.1f;
inline constexpr float kLighterSupport = 0.6f;  // above it the votes may decide them, too

// The functions below are templates over F, float or a vector of floats with the operators of float, so that
// the CPU form decides 16 pixels at once. A condition serves one choice and is joined with no other: GCC 12
// decides lane by lane where it is not.
template <class F>
KINEVOX_HD KINEVOX_INLINE F smaller(F a, F b) {
    return a < b ? a : b;
}
template <class F>
KINEVOX_HD KINEVOX_INLINE F all_of(float value) {
    return F{} + value;
}
template <class F>
KINEVOX_HD KINEVOX_INLINE F above(F value, F from) {
    return value > from ? value - from : F{};
}

template <class F>
struct IntegersOf {
    using Type = std::int32_t;
};

template <class F, class I>
KINEVOX_HD KINEVOX_INLINE F to_floats(I integers) {
#ifndef __CUDACC__
    if constexpr (!std::is_same_v<F, float>)
        return __builtin_convertvector(integers, F);
    else
#endif
        return static_cast<F>(integers);
}

// The natural logarithm of a positive number to 2e-5, the same on every device.
template <class F>
KINEVOX_HD KINEVOX_INLINE F log_of(F x) {
    using I = typename IntegersOf<F>::Type;
    I bits;
    memcpy(&bits, &x, sizeof bits);
    const I exponent = (bits >> 23) - 127;
    bits = (bits & 0x007fffff) | 0x3f800000;
    F m;
    memcpy(&m, &bits, sizeof m);
    // log2 of 1..2 by a polynomial of the fifth degree (minimax, error 1.4e-5).
    const F p = ((((0.0439287f * m - 0.4094758f) * m + 1.6101775f) * m - 3.5202188f) * m + 5.0697563f) * m -
                2.7941537f;
    return 0.6931472f * (to_floats<F>(exponent) + p);
}

inline constexpr float kMaxFloorResidual = 12;  // variances per pixel
inline constexpr float kMaxFloorLight = 1.12f;

// The light of a floor point in a camera over that of its background, 1 in unchanged light; negative where
// the camera does not see the point or sees something else there.
template <int kChannels>
KINEVOX_HD inline float light_of_floor(const SceneView& view, float x, float y, const EvidenceParameters& p) {
    float u, v;
    if (!to_pixel(view.camera, to_camera(view.camera, x, y, 0), u, v)) return -1;
    const int cu = to_index(u), cv = to_index(v);
    if (cu < 1 || cv < 1 || cu >= view.camera.width - 1 || cv >= view.camera.height - 1) return -1;
    const auto cell_of = [&](int px, int py) {
        return (static_cast<std::ptrdiff_t>(py) * view.cells_per_row + px / kCellPixels) * kChannels *
                   kCellPixels +
               px % kCellPixels;
    };
    float product = 0, energy = 0, residual = 0, scales = 0, variances = 0;
    constexpr int kCross[5][2] = {{0, 0}, {-1, 0}, {1, 0}, {0, -1}, {0, 1}};
    for (const auto& step : kCross) {
        const int px = cu + step[0], py = cv + step[1];
        const std::uint8_t* pixel =
            view.image + py * view.image_stride + static_cast<std::ptrdiff_t>(px) * kChannels;
        const std::uint8_t* reference = view.reference + cell_of(px, py);
        float pixel_product = 0, pixel_energy = 1, square = 0;
        for (int c = 0; c < kChannels; ++c) {
            const float r = reference[c * kCellPixels];
            const float value = static_cast<float>(pixel[c] * view.inverse_gain[c]) * (1.0f / 16384.0f);
            pixel_product += value * r;
            pixel_energy += r * r;
            square += value * value;
        }
        residual += square - pixel_product * pixel_product / pixel_energy;  // from its own light
        product += pixel_product;
        energy += pixel_energy;
    }
    const std::ptrdiff_t centre = cell_of(cu, cv);
    for (int c = 0; c < kChannels; ++c) {
        const float r = view.reference[centre + c * kCellPixels], s = view.scale[centre + c * kCellPixels];
        scales += s * s;
        variances += scaled_variance(r, s * s, p);
    }
    const float light = product / energy;
    return residual * scales > 5 * kMaxFloorResidual * variances || light > kMaxFloorLight ? -1.0f : light;
}

inline constexpr float kUnknownOver = -1000;  // below every other

// What is known of doubtful pixels.
template <class F>
struct ShadowEvidence {
    F lit;         // log density of the background in unchanged light, over its peak, nats
    F colour;      // log density of its colour on the subject over that of an unseen colour, nats
    F residual;    // squared distance from the background in another light, variances
    F around;      // the same, mean of 3 x 3
    F light;       // its light, mean of 3 x 3
    F step;        // smallest difference between its light and that of a neighbourhood
    F misfit;      // mean squared misfit of one light to the patch around it, variances
    F min_misfit;  // the same, smallest of nine patches that contain it
    F over;        // brightest light of its floor point in another camera less its own, or kUnknownOver
    F spread;      // smallest difference between the lights of its floor point
    F floor;       // 1 if another camera sees its floor point, else 0
    F support;     // see support_of()
};

// Of floats in a row.
template <class F>
KINEVOX_HD KINEVOX_INLINE F load(const float* from) {
    F value;
    memcpy(&value, from, sizeof value);
    return value;
}

// Values of a frame's planes, pointing at the first pixel.
struct ShadowPixels {
    const float *factor, *residual, *neighbourhood, *misfit;
    std::ptrdiff_t stride;
};

template <class F>
KINEVOX_HD KINEVOX_INLINE F mean_of_nine(const float* at, std::ptrdiff_t stride) {
    const F upper = load<F>(at - stride - 1) + load<F>(at - stride) + load<F>(at - stride + 1),
            middle = load<F>(at - 1) + load<F>(at) + load<F>(at + 1),
            lower = load<F>(at + stride - 1) + load<F>(at + stride) + load<F>(at + stride + 1);
    return (upper + middle + lower) * (1.0f / 9);
}

// Whether the pixel that `factor` points at is lighter than any shadow.
KINEVOX_HD inline bool is_lighter(const float* factor, std::ptrdiff_t stride) {
    return mean_of_nine<float>(factor, stride) > kBrightestShadow;
}

// All but what the other cameras see. distance: squared distance from the background in bandwidths / 256;
// log_foreground: log density of the pixel's colour on the subject; noise_factor: of squared distances.
template <int kChannels, class F>
KINEVOX_HD KINEVOX_INLINE ShadowEvidence<F> own_evidence(F distance, F log_foreground,
                                                         const ShadowPixels& pixels, float noise_factor) {
    ShadowEvidence<F> e;
    e.lit = noise_factor * (-0.5f / 65536.0f) * distance;
    e.colour = log_foreground - static_cast<float>(kChannels) * kLogUniformLevel;
    e.residual = noise_factor * load<F>(pixels.residual);
    e.around = noise_factor * mean_of_nine<F>(pixels.residual, pixels.stride);
    e.light = mean_of_nine<F>(pixels.factor, pixels.stride);
    e.step = all_of<F>(10);
    const F own = load<F>(pixels.factor);
    for (int side = -1; side <= 1; ++side) {
        const F across = own - load<F>(pixels.neighbourhood + side * kLightRadius * pixels.stride);
        const F along = own - load<F>(pixels.neighbourhood + side * kLightRadius);
        e.step = smaller(e.step, across < 0 ? -across : across);
        e.step = smaller(e.step, along < 0 ? -along : along);
    }
    e.misfit = e.min_misfit = load<F>(pixels.misfit);
    for (int row = -kPatchRadius; row <= kPatchRadius; row += kPatchRadius)
        for (int column = -kPatchRadius; column <= kPatchRadius; column += kPatchRadius)
            e.min_misfit = smaller(e.min_misfit, load<F>(pixels.misfit + row * pixels.stride + column));
    e.misfit *= noise_factor;
    e.min_misfit *= noise_factor;
    e.over = all_of<F>(kUnknownOver);
    e.floor = F{};
    e.spread = all_of<F>(1);
    e.support = all_of<F>(kUnknownSupport);
    return e;
}

// Adds the light of the pixels' floor points in another camera; negative: not known there.
template <class F>
KINEVOX_HD KINEVOX_INLINE void add_floor_light(ShadowEvidence<F>& e, F light) {
    const F over = light < 0 ? all_of<F>(kUnknownOver) : light - e.light;
    e.over = e.over > over ? e.over : over;
    e.spread = smaller(e.spread, over < 0 ? -over : over);
    e.floor = over > kUnknownOver ? all_of<F>(1) : e.floor;
}

// Pixels that share the lights of their floor point, in rows and columns.
inline constexpr int kFloorBlock_px = 4;
// Of the block that has the pixel, along one axis.
template <int kBlock_px>
KINEVOX_HD inline float block_centre(int pixel) {
    return static_cast<float>(pixel - pixel % kBlock_px) + 0.5f * (kBlock_px - 1);
}

// Whether the votes may add a pixel to the subject. Beside a contour they support almost everything, since
// the rays pass close to the subject there, and real images are doubtful there; what clothes like the
// background lose is whole limbs. So they decide only within a square of about a limb's width of which they
// change this share or more.
inline constexpr int kMinVotedPercent = 40;
// Blocks from the square's centre to its border; its sides are a ninth of the square root of the subject's
// area, in whole blocks.
KINEVOX_HD inline int voted_radius(int subject_blocks) {
    constexpr int kDividend = 70;
    int radius = 1;
    while (kDividend * (2 * radius + 1) * (2 * radius + 1) <= subject_blocks) ++radius;
    return radius;
}
KINEVOX_HD inline bool is_limb(int voted_pixels, int radius) {
    const int pixels = (2 * radius + 1) * (2 * radius + 1) * kVoteBlock_px * kVoteBlock_px;
    return 100 * voted_pixels >= kMinVotedPercent * pixels;
}

// The rule's inputs, kShadowFeatures of them. The first is constant.
template <class F>
KINEVOX_HD KINEVOX_INLINE void shadow_features(const ShadowEvidence<F>& e, F* out) {
    const auto up_to = [](F value, float limit) { return smaller(value, all_of<F>(limit)); };
    const auto over = [](F value, float from) { return above(value, all_of<F>(from)); };
    const auto below = [](F value, float from) { return above(all_of<F>(from), value); };
    const F smallest = up_to(e.min_misfit, 100), dark = below(e.light, 0.95f);
    out[0] = all_of<F>(1);
    out[1] = log_of(up_to(-e.lit, 40) + 0.5f);
    out[2] = up_to(e.colour, 8);
    out[3] = log_of(up_to(e.residual, 100) + 0.3f);
    out[4] = log_of(up_to(e.around, 100) + 0.3f);
    out[5] = dark;
    out[6] = below(e.light, 0.8f);
    out[7] = below(e.light, 0.6f);
    out[8] = below(e.light, 0.45f);
    out[9] = over(e.light, 1.0f);
    out[10] = over(e.light, 1.1f);
    out[11] = log_of(e.step + 0.01f);
    out[12] = log_of(up_to(e.misfit, 100) + 0.3f);
    out[13] = log_of(smallest + 0.3f);
    out[14] = up_to(over(smallest, 1), 4);
    out[15] = e.floor;
    out[16] = e.floor * over(e.over, 0.03f);
    out[17] = e.floor * over(e.over, 0.1f);
    out[18] = e.floor * over(e.over, 0.25f);
    out[19] = e.floor * below(e.over, 0);
    out[20] = e.floor * below(e.spread, 0.1f);
    out[21] = e.floor * below(e.spread, 0.04f);
    const F known = e.support > kMaxKnownSupport ? F{} : all_of<F>(1);
    out[22] = known;
    out[23] = known * e.support;
    out[24] = known * over(e.support, 0);
    out[25] = known * over(e.support, 0.4f);
    out[26] = known * over(e.support, 0.75f);
}

// The features whose products the rule weighs, too: which two of them occur together says more than each.
template <class F>
KINEVOX_HD KINEVOX_INLINE void shadow_bases(const F* features, F* out) {
    out[0] = features[1];
    out[1] = 0.25f * features[2];
    out[2] = features[4];
    out[3] = 4 * features[5];
    out[4] = 4 * features[9];
    out[5] = features[12];
    out[6] = features[13];
    out[7] = smaller(4 * features[16], all_of<F>(1.6f));
    out[8] = 10 * features[20];
    out[9] = features[15];
}

// Log odds of the subject against a shadow, nats; scaled as shadow_rule.py states.
template <class F>
struct ShadowLogOdds {
    F own;    // without the votes
    F voted;  // with them
    // Whether the votes, and they alone, make it the subject.
    KINEVOX_HD bool changed() const { return own <= 0 && voted > 0; }
};

template <class F>
KINEVOX_HD KINEVOX_INLINE F limited(F log_odds) {
    constexpr float kLimit = 8;
    return -smaller(-smaller(log_odds, all_of<F>(kLimit)), all_of<F>(kLimit));
}

template <class F>
KINEVOX_HD KINEVOX_INLINE ShadowLogOdds<F> shadow_log_odds(const ShadowEvidence<F>& evidence,
                                                           const ShadowRule& rule) {
    F features[kShadowFeatures], bases[kShadowBases], sum = F{}, per_vote = F{}, per_positive_vote = F{};
    shadow_features(evidence, features);
    shadow_bases(features, bases);
    for (int i = 0; i < kOwnShadowFeatures; ++i) sum += rule.weights[i] * features[i];
    int n = 0;
    for (int i = 0; i < kShadowBases; ++i) {
        F inner = F{};
        for (int j = i; j < kShadowBases; ++j) inner += rule.products[n++] * bases[j];
        sum += bases[i] * inner;
        per_vote += rule.vote_products[i] * bases[i];
        per_positive_vote += rule.positive_vote_products[i] * bases[i];
    }
    F votes =
        features[kOwnShadowFeatures + 1] * per_vote + features[kOwnShadowFeatures + 2] * per_positive_vote;
    for (int i = kOwnShadowFeatures; i < kShadowFeatures; ++i) votes += rule.weights[i] * features[i];
    constexpr int kLighter[kLighterFeatures] = {0, 1, 2, 4, 9, 10, 12, 13, 15, 19};
    F lighter = F{};
    for (int i = 0; i < kLighterFeatures; ++i) lighter += rule.lighter[i] * features[kLighter[i]];
    const F own = limited(evidence.light > kBrightestShadow ? lighter : sum);
    const F voted = limited(limited(sum) + votes);
    // The votes decide lighter pixels only where they are known and clear, the others always.
    constexpr float kClear = 0.5f * (kLighterSupport + kMaxKnownSupport);
    const F support = evidence.light - kBrightestShadow > 0 ? evidence.support : all_of<F>(kClear);
    const F known = support < kMaxKnownSupport ? support : all_of<F>(kNoSupport);
    return {own, known > kLighterSupport ? voted : own};
}

}  // namespace kinevox::kernels::kde
