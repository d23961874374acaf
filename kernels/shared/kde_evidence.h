// From the background's density to the evidence for foreground of one pixel: a log-likelihood ratio in nats.
//
// Three explanations compete. Lit background: the kernel density. Background in another light (shadow or
// lamp): the pixel is the reference times one factor for all channels, so its chromaticity is the same
// (Horprasert et al. 1999), and the factor is near its neighbourhood's, because shadows are smooth and cloth
// is not. Foreground: colours seen on the subject before, mixed with a uniform density for those not seen
// yet.
#pragma once

#include <cstdint>

#include "kernels/shared/device.h"
#include "kernels/shared/kde_density.h"
#include "kernels/shared/shadow_weights.h"

namespace kinevox::kernels::kde {

inline constexpr float kLogUniformLevel = -5.545177f;  // log(1 / 256)
inline constexpr float kLogGaussianPeak = -0.918939f;  // log(1 / sqrt(2 pi))
inline constexpr int kHistogramBins = 16;              // per channel, of 16 grey levels each
inline constexpr int kLightRadius = 2;                 // px; the light's neighbourhood is 5 x 5

struct EvidenceParameters {
    float darkest = 0.35f, brightest = 1.25f;  // range of the light's factor
    float log_prior_light = -2.3f;             // of a pixel being background in another light
    float light_smoothness = 5.0f;             // weight of the factor's difference from the neighbourhood
    float light_std = 0.015f;                  // of the factor inside a neighbourhood
    float coarse_residual = 14.0f;             // above it a pixel is no evidence for its neighbours' light
    // Variance of a pixel around its light: this fraction of the squared bandwidth, which is generous for the
    // kernel sum, and of the brightness.
    float noise_fraction = 0.3f;
    float relative_std = 0.01f;
    float limit = 8.0f;  // of the evidence, either sign, nats
    ShadowRule shadow;
};

// The variance of a channel around its light times the squared scale (256 / bandwidth), so that quotients by
// it take no division for the bandwidth.
KINEVOX_HD inline float scaled_variance(float reference, float squared_scale, const EvidenceParameters& p) {
    const float spread = p.relative_std * reference;
    return p.noise_fraction * 65536.0f + spread * spread * squared_scale;
}

// A sum of quotients that costs a single division in the end.
struct Quotient {
    float numerator = 0, denominator = 1;
    KINEVOX_HD void add(float over, float under) {
        numerator = numerator * under + over * denominator;
        denominator *= under;
    }
};

// How another light fits a pixel.
struct PixelLight {
    // Their sums' quotient over a neighbourhood is its light; a pixel that does not fit has no weight in it.
    float weighted_value = 0, weighted_energy = 0;
    float factor = 1;    // the pixel's light
    float residual = 0;  // squared distance from factor * reference, variances
    // Of value and reference over the pixel's variance, all channels; for the misfit of one light to a patch.
    float product = 0, energy = 0, square = 0;
};

// Fits the reference in another light to a pixel.
template <int kChannels>
KINEVOX_HD inline PixelLight fit_light(const std::uint8_t* value, const std::uint8_t* reference,
                                       const std::uint8_t* scale, const EvidenceParameters& p) {
    float product = 0, energy = 0, square = 0, scales = 0, variances = 0;
    for (int c = 0; c < kChannels; ++c) {
        const float v = value[c * kCellPixels], r = reference[c * kCellPixels];
        product += v * r;
        energy += r * r;
        square += v * v;
    }
    float factor = product / (energy > 1.0f ? energy : 1.0f);
    factor = factor < p.darkest ? p.darkest : factor > p.brightest ? p.brightest : factor;
    Quotient squared_distance;
    for (int c = 0; c < kChannels; ++c) {
        const float v = value[c * kCellPixels], r = reference[c * kCellPixels], s = scale[c * kCellPixels];
        const float difference = v - factor * r, variance = scaled_variance(r, s * s, p);
        squared_distance.add(difference * difference * (s * s), variance);
        scales += s * s;
        variances += variance;
    }
    const float residual = squared_distance.numerator / squared_distance.denominator;
    const float margin = 1.0f - residual * (1.0f / p.coarse_residual);
    const float weight = margin > 0 ? margin : 0;
    const float precision = scales / variances;
    return {weight * product,   weight * energy,   factor, residual, precision * product,
            precision * energy, precision * square};
}

// From the background in unchanged light, bandwidths / 256.
template <int kChannels>
KINEVOX_HD inline float squared_distance(const std::uint8_t* value, const std::uint8_t* reference,
                                         const std::uint8_t* scale) {
    float sum = 0;
    for (int c = 0; c < kChannels; ++c) {
        const float s = scale[c * kCellPixels];
        const auto difference = static_cast<float>(value[c * kCellPixels] - reference[c * kCellPixels]);
        sum += difference * difference * (s * s);
    }
    return sum;
}

// log_lit: log of the kernel density over its peak, from a table by density(); for density 0 it is the upper
// bound and the distance from the reference is more precise. log_peak: log of the density's peak. light_step:
// how far the pixel's light is from its neighbourhood's, the nearest of the neighbourhoods around it and at
// its four sides, since a hard shadow ends between two pixels. log_foreground: log density of the pixel's
// colour on the subject.
template <int kChannels>
KINEVOX_HD inline float evidence(const std::uint8_t* value, const std::uint8_t* reference,
                                 const std::uint8_t* scale, int density, float log_lit, float log_peak,
                                 float residual, float light_step, float log_foreground,
                                 const EvidenceParameters& p) {
    float distance = 0;
    Quotient precision;
    for (int c = 0; c < kChannels; ++c) {
        const float v = value[c * kCellPixels], r = reference[c * kCellPixels], s = scale[c * kCellPixels];
        precision.add(r * r * (s * s), scaled_variance(r, s * s, p));
        distance += (v - r) * (v - r) * (s * s);
    }
    const float tail = -0.5f / 65536.0f * distance;
    const float floor = tail < log_lit ? tail : log_lit;
    const float lit = density > 0 ? log_lit : floor;
    // The variance of the step is 1 / (1 + precision) + light_std^2.
    const float certain = precision.denominator + precision.numerator;
    const float disagreement = residual + p.light_smoothness * light_step * light_step * certain /
                                              (precision.denominator + p.light_std * p.light_std * certain);
    const float light = p.log_prior_light - 0.5f * disagreement;
    const float ratio = log_foreground - log_peak - (lit > light ? lit : light);
    return ratio < -p.limit ? -p.limit : ratio > p.limit ? p.limit : ratio;
}

// Logarithm of the highest value that a pixel's density can have. `log_scale`: of the 256 bandwidth scales.
KINEVOX_HD inline float log_peak_of(const float* log_scale, const std::uint8_t* scale, int channels) {
    float log_peak = kLogGaussianPeak * static_cast<float>(channels);
    for (int c = 0; c < channels; ++c) log_peak += log_scale[scale[c * kCellPixels]];
    return log_peak;
}

template <int kChannels>
KINEVOX_HD inline int histogram_bin(const std::uint8_t* value) {
    int bin = 0;
    for (int c = 0; c < kChannels; ++c) bin = bin * kHistogramBins + (value[c * kCellPixels] >> 4);
    return bin;
}

// Which pixels the evidence is worked out for: those near a pixel that may be foreground, by groups that fit
// a vector register. CPU and CUDA look at the same ones.
inline constexpr int kGroupPixels = 16;
inline constexpr int kActiveMargin =
    4;  // px in rows and columns: radius of the light's neighbourhood plus that of the smoothing
// Rows around the active ones that hold neutral values: patches of radius 3 at 3 px from an active pixel.
inline constexpr int kNeutralMargin = 6;
inline constexpr int kSlices = kCellPixels / kActiveMargin;  // of a cell, as wide as the margin

// Groups of a cell as bits, from the left; beside them those of the cells to the left and to the right.
inline constexpr int kAllGroups = (1 << kCellPixels / kGroupPixels) - 1;
inline constexpr int kLastGroup = (kAllGroups + 1) / 2;
inline constexpr int kNearLeft = kAllGroups + 1, kNearRight = 2 * kNearLeft;

// The groups within the margin of unsure pixels. slices: a bit for each slice that holds such a pixel.
KINEVOX_HD inline int groups_near(int slices) {
    constexpr int kSlicesOfGroup = kGroupPixels / kActiveMargin;
    const int wide = slices | slices << 1 | slices >> 1;
    int groups = (slices & 1 ? kNearLeft : 0) | (slices >> (kSlices - 1) & 1 ? kNearRight : 0);
    for (int g = 0; g < kCellPixels / kGroupPixels; ++g)
        if (wide >> g * kSlicesOfGroup & ((1 << kSlicesOfGroup) - 1)) groups |= 1 << g;
    return groups;
}

}  // namespace kinevox::kernels::kde
