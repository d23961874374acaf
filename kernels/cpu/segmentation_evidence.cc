#include "kernels/cpu/segmentation_evidence.h"

#include <cstring>

// Plain loops, which the compiler vectorises for each family that Highway chooses from at run time; no two of
// their arrays overlap (ivdep).
#ifdef KINEVOX_HAVE_HIGHWAY
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/cpu/segmentation_evidence.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
HWY_BEFORE_NAMESPACE();
#else
#define HWY_NAMESPACE plain
#endif

namespace kinevox::kernels::cpu::HWY_NAMESPACE {

using kde::kCellPixels;

template <int kChannels>
void fit_light_of(const EvidenceCell& cell, const kde::EvidenceParameters& parameters, const LightRows& out) {
    const kde::EvidenceParameters p = parameters;
    const std::uint8_t* value = cell.value;
    const std::uint8_t* reference = cell.reference;
    const std::uint8_t* scale = cell.scale;
    float* __restrict weighted_value = out.weighted_value, * __restrict weighted_energy = out.weighted_energy;
    float* __restrict factor = out.factor, * __restrict residual = out.residual;
#pragma GCC ivdep
    for (int x = 0; x < kCellPixels; ++x)
        kde::fit_light<kChannels>(value + x, reference + x, scale + x, p, weighted_value[x],
                                  weighted_energy[x], factor[x], residual[x]);
}

void fit_light_cell(const EvidenceCell& cell, const kde::EvidenceParameters& parameters,
                    const LightRows& out) {
    if (cell.channels == 1)
        fit_light_of<1>(cell, parameters, out);
    else
        fit_light_of<3>(cell, parameters, out);
}

void neighbourhood_light(const float* weighted_value, const float* weighted_energy, std::ptrdiff_t stride,
                         int width, float* light) {
    constexpr int kReach = kde::kLightReach;
    static_assert(kReach == 2);
    float value[kMostRowPixels + 2 * kReach], energy[kMostRowPixels + 2 * kReach];
    const auto columns = [&](const float* plane, float* sum) {
        const float* a = plane - kReach * stride - kReach;
        const float *b = a + stride, *c = b + stride, *d = c + stride, *e = d + stride;
#pragma GCC ivdep
        for (int x = 0; x < width + 2 * kReach; ++x) sum[x] = a[x] + b[x] + c[x] + d[x] + e[x];
    };
    columns(weighted_value, value);
    columns(weighted_energy, energy);
    float* __restrict quotient = light;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        const float v = value[x] + value[x + 1] + value[x + 2] + value[x + 3] + value[x + 4];
        const float e = energy[x] + energy[x + 1] + energy[x + 2] + energy[x + 3] + energy[x + 4];
        quotient[x] = e > 0 ? v / e : 1.0f;
    }
}

template <int kChannels>
void evidence_of(const EvidenceCell& cell, const kde::EvidenceParameters& parameters,
                 const LightAround& light, const float* log_lit, const float* log_foreground,
                 float* evidence) {
    constexpr int kReach = kde::kLightReach;
    const kde::EvidenceParameters p = parameters;
    float colour[kCellPixels], lit[kCellPixels], step[kCellPixels];
    const float *above = light.neighbourhood - kReach * light.stride, *around = light.neighbourhood,
                *below = light.neighbourhood + kReach * light.stride;
    const float *own_factor = light.factor, *own_residual = light.residual;
#pragma GCC ivdep
    for (int x = 0; x < kCellPixels; ++x) {
        const float factor = own_factor[x];
        const auto nearer = [factor](float nearest, float other) {
            const float difference = factor - other;
            const float size = difference < 0 ? -difference : difference;
            return size < nearest ? size : nearest;
        };
        step[x] = nearer(nearer(nearer(nearer(nearer(10.0f, above[x]), around[x - kReach]), around[x]),
                                around[x + kReach]),
                         below[x]);
    }
    for (int x = 0; x < kCellPixels; ++x) {
        colour[x] = log_foreground[kde::histogram_bin<kChannels>(cell.value + x)];
        lit[x] = log_lit[cell.density[x]];
    }
    const std::uint8_t* value = cell.value;
    const std::uint8_t* reference = cell.reference;
    const std::uint8_t* scale = cell.scale;
    const std::uint8_t* density = cell.density;
    const float* log_peak = cell.log_peak;
    float* __restrict out = evidence;
#pragma GCC ivdep
    for (int x = 0; x < kCellPixels; ++x)
        out[x] = kde::evidence<kChannels>(value + x, reference + x, scale + x, density[x], lit[x],
                                          log_peak[x], own_residual[x], step[x], colour[x], p);
}

void evidence_cell(const EvidenceCell& cell, const kde::EvidenceParameters& parameters,
                   const LightAround& light, const float* log_lit, const float* log_foreground,
                   float* evidence) {
    if (cell.channels == 1)
        evidence_of<1>(cell, parameters, light, log_lit, log_foreground, evidence);
    else
        evidence_of<3>(cell, parameters, light, log_lit, log_foreground, evidence);
}

void smooth_row(const float* const rows[5], const float weights[5], int width, float* scratch, float* out) {
    const float *a = rows[0] - 2, *b = rows[1] - 2, *c = rows[2] - 2, *d = rows[3] - 2, *e = rows[4] - 2;
    const float w0 = weights[0], w1 = weights[1], w2 = weights[2];
    float* __restrict across = scratch;
    for (int x = 0; x < width + 4; ++x) across[x] = w0 * (a[x] + e[x]) + w1 * (b[x] + d[x]) + w2 * c[x];
    float* __restrict result = out;
    for (int x = 0; x < width; ++x)
        result[x] =
            w0 * (across[x] + across[x + 4]) + w1 * (across[x + 1] + across[x + 3]) + w2 * across[x + 2];
}

void decide_row(const float* evidence, int width, const Decision& decision, std::uint8_t* probability,
                std::uint8_t* sharp, std::uint8_t* loose) {
    const float to_step = 127.5f / decision.limit;
    const float sharp_from = decision.sharp, loose_from = decision.loose;
    const float* __restrict in = evidence;
    std::uint8_t* __restrict sharp_out = sharp;
    std::uint8_t* __restrict loose_out = loose;
    std::uint8_t* __restrict step = probability;
    for (int x = 0; x < width; ++x) {
        step[x] = static_cast<std::uint8_t>(static_cast<int>(in[x] * to_step + 127.5f));
        sharp_out[x] = in[x] > sharp_from ? 255 : 0;
        loose_out[x] = in[x] > loose_from ? 255 : 0;
    }
    // Most pixels lie at the lower end or at the upper one.
    constexpr int kTogether = 8;
    int x = 0;
    for (; x + kTogether <= width; x += kTogether) {
        std::uint64_t steps;
        std::memcpy(&steps, step + x, kTogether);
        if (steps == 0 || steps == ~std::uint64_t{0})
            std::memset(probability + x, decision.probability_of[steps & 255], kTogether);
        else
            for (int i = x; i < x + kTogether; ++i) probability[i] = decision.probability_of[step[i]];
    }
    for (; x < width; ++x) probability[x] = decision.probability_of[step[x]];
}

}  // namespace kinevox::kernels::cpu::HWY_NAMESPACE

#ifdef KINEVOX_HAVE_HIGHWAY
HWY_AFTER_NAMESPACE();
#endif

#if !defined(KINEVOX_HAVE_HIGHWAY) || HWY_ONCE
namespace kinevox::kernels::cpu {
#ifdef KINEVOX_HAVE_HIGHWAY
HWY_EXPORT(fit_light_cell);
HWY_EXPORT(neighbourhood_light);
HWY_EXPORT(evidence_cell);
HWY_EXPORT(smooth_row);
HWY_EXPORT(decide_row);
#define KINEVOX_DISPATCH(function) HWY_DYNAMIC_DISPATCH(function)
#else
#define KINEVOX_DISPATCH(function) plain::function
#endif

void fit_light_cell(const EvidenceCell& cell, const kde::EvidenceParameters& parameters,
                    const LightRows& out) {
    KINEVOX_DISPATCH(fit_light_cell)(cell, parameters, out);
}
void neighbourhood_light(const float* weighted_value, const float* weighted_energy, std::ptrdiff_t stride,
                         int width, float* light) {
    KINEVOX_DISPATCH(neighbourhood_light)(weighted_value, weighted_energy, stride, width, light);
}
void evidence_cell(const EvidenceCell& cell, const kde::EvidenceParameters& parameters,
                   const LightAround& light, const float* log_lit, const float* log_foreground,
                   float* evidence) {
    KINEVOX_DISPATCH(evidence_cell)(cell, parameters, light, log_lit, log_foreground, evidence);
}
void smooth_row(const float* const rows[5], const float weights[5], int width, float* scratch, float* out) {
    KINEVOX_DISPATCH(smooth_row)(rows, weights, width, scratch, out);
}
void decide_row(const float* evidence, int width, const Decision& decision, std::uint8_t* probability,
                std::uint8_t* sharp, std::uint8_t* loose) {
    KINEVOX_DISPATCH(decide_row)(evidence, width, decision, probability, sharp, loose);
}
#undef KINEVOX_DISPATCH
}  // namespace kinevox::kernels::cpu
#endif
