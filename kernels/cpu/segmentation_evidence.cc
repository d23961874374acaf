#include "kernels/cpu/segmentation_evidence.h"

#include <cstdlib>

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

template <int kChannels>
void evidence_of(const EvidenceCell& cell, const kde::EvidenceParameters& parameters, const LightRows& light,
                 std::ptrdiff_t stride, const float* log_lit, const float* log_foreground, float* evidence) {
    constexpr int kReach = kde::kLightReach, kFar = 2 * kReach, kSpan = kCellPixels + 2 * kFar;
    const kde::EvidenceParameters p = parameters;
    // Sums of columns of 2 * kReach + 1 rows: ending at this row, around it, beginning at it.
    float values[3][kSpan] = {}, energies[3][kSpan] = {};
    float colour[kCellPixels], lit[kCellPixels], step[kCellPixels];
    for (int dy = -kFar; dy <= kFar; ++dy) {
        const float* value = light.weighted_value + dy * stride - kFar;
        const float* energy = light.weighted_energy + dy * stride - kFar;
        for (int side = 0; side < 3; ++side) {
            if (std::abs(dy - (side - 1) * kReach) > kReach) continue;
            for (int x = 0; x < kSpan; ++x) {
                values[side][x] += value[x];
                energies[side][x] += energy[x];
            }
        }
    }
    const float *own_factor = light.factor, *own_residual = light.residual;
    for (int x = 0; x < kCellPixels; ++x) step[x] = 10.0f;
    const auto compare = [&](const float* column_values, const float* column_energies, int dx) {
        for (int x = 0; x < kCellPixels; ++x) {
            float value = 0, energy = 0;
            for (int i = 0; i <= 2 * kReach; ++i) {
                value += column_values[x + dx + i];
                energy += column_energies[x + dx + i];
            }
            const float difference = own_factor[x] - (energy > 0 ? value / energy : 1.0f);
            const float size = difference < 0 ? -difference : difference;
            step[x] = size < step[x] ? size : step[x];
        }
    };
    compare(values[0], energies[0], kReach);
    compare(values[1], energies[1], 0);
    compare(values[1], energies[1], kReach);
    compare(values[1], energies[1], 2 * kReach);
    compare(values[2], energies[2], kReach);
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
                   const LightRows& light, std::ptrdiff_t stride, const float* log_lit,
                   const float* log_foreground, float* evidence) {
    if (cell.channels == 1)
        evidence_of<1>(cell, parameters, light, stride, log_lit, log_foreground, evidence);
    else
        evidence_of<3>(cell, parameters, light, stride, log_lit, log_foreground, evidence);
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

}  // namespace kinevox::kernels::cpu::HWY_NAMESPACE

#ifdef KINEVOX_HAVE_HIGHWAY
HWY_AFTER_NAMESPACE();
#endif

#if !defined(KINEVOX_HAVE_HIGHWAY) || HWY_ONCE
namespace kinevox::kernels::cpu {
#ifdef KINEVOX_HAVE_HIGHWAY
HWY_EXPORT(fit_light_cell);
HWY_EXPORT(evidence_cell);
HWY_EXPORT(smooth_row);
#define KINEVOX_DISPATCH(function) HWY_DYNAMIC_DISPATCH(function)
#else
#define KINEVOX_DISPATCH(function) plain::function
#endif

void fit_light_cell(const EvidenceCell& cell, const kde::EvidenceParameters& parameters,
                    const LightRows& out) {
    KINEVOX_DISPATCH(fit_light_cell)(cell, parameters, out);
}
void evidence_cell(const EvidenceCell& cell, const kde::EvidenceParameters& parameters,
                   const LightRows& light, std::ptrdiff_t stride, const float* log_lit,
                   const float* log_foreground, float* evidence) {
    KINEVOX_DISPATCH(evidence_cell)(cell, parameters, light, stride, log_lit, log_foreground, evidence);
}
void smooth_row(const float* const rows[5], const float weights[5], int width, float* scratch, float* out) {
    KINEVOX_DISPATCH(smooth_row)(rows, weights, width, scratch, out);
}
#undef KINEVOX_DISPATCH
}  // namespace kinevox::kernels::cpu
#endif
