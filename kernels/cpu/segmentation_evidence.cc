#include "kernels/cpu/segmentation_evidence.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "kernels/cpu/dispatch.h"
#include "kernels/shared/kde_evidence.h"

// Compiled for each family that Highway chooses from at run time. The plain loops are vectorised by the
// compiler; no two of their arrays overlap (ivdep).
#ifdef KINEVOX_HAVE_HIGHWAY
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/cpu/segmentation_evidence.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
HWY_BEFORE_NAMESPACE();
#endif

namespace kinevox::kernels::cpu::HWY_NAMESPACE {

using kde::kCellPixels;
using kde::kGroupPixels;

#ifdef KINEVOX_HAVE_HIGHWAY
namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::CappedTag<float, kGroupPixels>;
using Numbers = hn::Rebind<std::int32_t, Floats>;
using Bytes = hn::Rebind<std::uint8_t, Floats>;
using V = hn::Vec<Floats>;

HWY_INLINE V levels(const std::uint8_t* bytes) {
    return hn::ConvertTo(Floats(), hn::PromoteTo(Numbers(), hn::LoadU(Bytes(), bytes)));
}

// kde::scaled_variance()
HWY_INLINE V scaled_variance(V reference, V squared_scale, const kde::EvidenceParameters& p) {
    const Floats f;
    const V spread = hn::Mul(hn::Set(f, p.relative_std), reference);
    return hn::MulAdd(hn::Mul(spread, spread), squared_scale, hn::Set(f, p.noise_fraction * 65536.0f));
}

// kde::Quotient
struct QuotientLanes {
    V numerator, denominator;
    HWY_INLINE QuotientLanes() : numerator(hn::Zero(Floats())), denominator(hn::Set(Floats(), 1.0f)) {}
    HWY_INLINE void add(V over, V under) {
        numerator = hn::MulAdd(numerator, under, hn::Mul(over, denominator));
        denominator = hn::Mul(denominator, under);
    }
};

// kde::fit_light() of pixels from x on.
template <int kChannels>
HWY_INLINE void fit_light_at(const EvidenceCell& cell, const kde::EvidenceParameters& p, const LightRows& out,
                             int x) {
    const Floats f;
    V value[kChannels], reference[kChannels], product = hn::Zero(f), energy = hn::Zero(f);
    V square = hn::Zero(f), scales = hn::Zero(f), variances = hn::Zero(f);
    for (int c = 0; c < kChannels; ++c) {
        value[c] = levels(cell.value + c * kCellPixels + x);
        reference[c] = levels(cell.reference + c * kCellPixels + x);
        product = hn::MulAdd(value[c], reference[c], product);
        energy = hn::MulAdd(reference[c], reference[c], energy);
        square = hn::MulAdd(value[c], value[c], square);
    }
    const V factor =
        hn::Min(hn::Max(hn::Div(product, hn::Max(energy, hn::Set(f, 1.0f))), hn::Set(f, p.darkest)),
                hn::Set(f, p.brightest));
    QuotientLanes squared_distance;
    for (int c = 0; c < kChannels; ++c) {
        const V scale = levels(cell.scale + c * kCellPixels + x), squared_scale = hn::Mul(scale, scale);
        const V difference = hn::NegMulAdd(factor, reference[c], value[c]);
        const V variance = scaled_variance(reference[c], squared_scale, p);
        squared_distance.add(hn::Mul(hn::Mul(difference, difference), squared_scale), variance);
        scales = hn::Add(scales, squared_scale);
        variances = hn::Add(variances, variance);
    }
    const V residual = hn::Div(squared_distance.numerator, squared_distance.denominator);
    const V weight =
        hn::Max(hn::NegMulAdd(residual, hn::Set(f, 1.0f / p.coarse_residual), hn::Set(f, 1.0f)), hn::Zero(f));
    hn::StoreU(hn::Mul(weight, product), f, out.weighted_value + x);
    hn::StoreU(hn::Mul(weight, energy), f, out.weighted_energy + x);
    hn::StoreU(factor, f, out.factor + x);
    hn::StoreU(residual, f, out.residual + x);
    const V precision = hn::Div(scales, variances);
    hn::StoreU(hn::Mul(precision, product), f, out.product + x);
    hn::StoreU(hn::Mul(precision, energy), f, out.energy + x);
    hn::StoreU(hn::Mul(precision, square), f, out.square + x);
}

// kde::histogram_bin()
template <int kChannels>
HWY_INLINE hn::Vec<Numbers> histogram_bins(const std::uint8_t* value) {
    static_assert(kde::kHistogramBins == 16);
    const Numbers n;
    auto bin = hn::Zero(n);
    for (int c = 0; c < kChannels; ++c)
        bin = hn::Or(hn::ShiftLeft<4>(bin),
                     hn::ShiftRight<4>(hn::PromoteTo(n, hn::LoadU(Bytes(), value + c * kCellPixels))));
    return bin;
}

// kde::evidence() of pixels from x on.
template <int kChannels>
HWY_INLINE void evidence_at(const EvidenceCell& cell, const kde::EvidenceParameters& p,
                            const LightAround& light, const float* log_lit, const float* log_foreground,
                            const EvidenceRows& out, int x) {
    constexpr int kRadius = kde::kLightRadius;
    const Floats f;
    const float *around = light.neighbourhood + x, *above = around - kRadius * light.stride,
                *below = around + kRadius * light.stride;
    const V factor = hn::LoadU(f, light.factor + x);
    V step = hn::Set(f, 10.0f);
    for (const float* other : {above, around - kRadius, around, around + kRadius, below})
        step = hn::Min(step, hn::AbsDiff(factor, hn::LoadU(f, other)));
    V distance = hn::Zero(f);
    QuotientLanes precision;
    for (int c = 0; c < kChannels; ++c) {
        const V value = levels(cell.value + c * kCellPixels + x);
        const V reference = levels(cell.reference + c * kCellPixels + x);
        const V scale = levels(cell.scale + c * kCellPixels + x), squared_scale = hn::Mul(scale, scale);
        precision.add(hn::Mul(hn::Mul(reference, reference), squared_scale),
                      scaled_variance(reference, squared_scale, p));
        const V difference = hn::Sub(value, reference);
        distance = hn::MulAdd(hn::Mul(difference, difference), squared_scale, distance);
    }
    const auto density = hn::PromoteTo(Numbers(), hn::LoadU(Bytes(), cell.density + x));
    const V table = hn::GatherIndex(f, log_lit, density);
    const V tail = hn::Mul(hn::Set(f, -0.5f / 65536.0f), distance);
    const auto none = hn::RebindMask(f, hn::Eq(density, hn::Zero(Numbers())));
    const V lit = hn::IfThenElse(none, hn::Min(tail, table), table);
    const V certain = hn::Add(precision.denominator, precision.numerator);
    const V spread = hn::MulAdd(hn::Set(f, p.light_std * p.light_std), certain, precision.denominator);
    const V disagreement = hn::Add(
        hn::LoadU(f, light.residual + x),
        hn::Div(hn::Mul(hn::Mul(hn::Set(f, p.light_smoothness), hn::Mul(step, step)), certain), spread));
    const V shaded = hn::NegMulAdd(hn::Set(f, 0.5f), disagreement, hn::Set(f, p.log_prior_light));
    const V colour = hn::GatherIndex(f, log_foreground, histogram_bins<kChannels>(cell.value + x));
    const V ratio = hn::Sub(hn::Sub(colour, hn::LoadU(f, cell.log_peak + x)), hn::Max(lit, shaded));
    hn::StoreU(hn::Min(hn::Max(ratio, hn::Set(f, -p.limit)), hn::Set(f, p.limit)), f, out.evidence + x);
    hn::StoreU(distance, f, out.distance + x);
    hn::StoreU(colour, f, out.colour + x);
}

// Calls at(x) for the first pixel of each vector of the groups.
template <class At>
HWY_INLINE void each_vector(int groups, const At& at) {
    for (auto left = static_cast<unsigned>(groups); left != 0; left &= left - 1)
        for (int x = 0; x < kGroupPixels; x += static_cast<int>(hn::Lanes(Floats())))
            at(std::countr_zero(left) * kGroupPixels + x);
}
#else
template <int kChannels>
void fit_light_at(const EvidenceCell& cell, const kde::EvidenceParameters& p, const LightRows& out, int x) {
    const kde::PixelLight light =
        kde::fit_light<kChannels>(cell.value + x, cell.reference + x, cell.scale + x, p);
    out.weighted_value[x] = light.weighted_value;
    out.weighted_energy[x] = light.weighted_energy;
    out.factor[x] = light.factor;
    out.residual[x] = light.residual;
    out.product[x] = light.product;
    out.energy[x] = light.energy;
    out.square[x] = light.square;
}

template <int kChannels>
void evidence_at(const EvidenceCell& cell, const kde::EvidenceParameters& p, const LightAround& light,
                 const float* log_lit, const float* log_foreground, const EvidenceRows& out, int x) {
    constexpr int kRadius = kde::kLightRadius;
    const float* around = light.neighbourhood + x;
    float step = 10.0f;
    for (const std::ptrdiff_t to : {-kRadius * light.stride, std::ptrdiff_t{-kRadius}, std::ptrdiff_t{0},
                                    std::ptrdiff_t{kRadius}, kRadius * light.stride})
        step = std::min(step, std::abs(light.factor[x] - around[to]));
    out.distance[x] = kde::squared_distance<kChannels>(cell.value + x, cell.reference + x, cell.scale + x);
    out.colour[x] = log_foreground[kde::histogram_bin<kChannels>(cell.value + x)];
    out.evidence[x] = kde::evidence<kChannels>(cell.value + x, cell.reference + x, cell.scale + x,
                                               cell.density[x], log_lit[cell.density[x]], cell.log_peak[x],
                                               light.residual[x], step, out.colour[x], p);
}

template <class At>
void each_vector(int groups, const At& at) {
    for (auto left = static_cast<unsigned>(groups); left != 0; left &= left - 1)
        for (int x = 0; x < kGroupPixels; ++x) at(std::countr_zero(left) * kGroupPixels + x);
}
#define HWY_ATTR
#endif

template <int kChannels>
void fit_light_of(const EvidenceCell& cell, int groups, const kde::EvidenceParameters& parameters,
                  const LightRows& out) {
    each_vector(groups, [&](int x) HWY_ATTR { fit_light_at<kChannels>(cell, parameters, out, x); });
}

void fit_light_cell(const EvidenceCell& cell, int groups, const kde::EvidenceParameters& parameters,
                    const LightRows& out) {
    if (cell.channels == 1)
        fit_light_of<1>(cell, groups, parameters, out);
    else
        fit_light_of<3>(cell, groups, parameters, out);
}

void neighbourhood_light(const float* weighted_value, const float* weighted_energy, std::ptrdiff_t stride,
                         int width, float* light) {
    constexpr int kRadius = kde::kLightRadius;
    static_assert(kRadius == 2);
    float value[kMaxRowPixels + 2 * kRadius], energy[kMaxRowPixels + 2 * kRadius];
    const auto columns = [&](const float* plane, float* sum) {
        const float* a = plane - kRadius * stride - kRadius;
        const float *b = a + stride, *c = b + stride, *d = c + stride, *e = d + stride;
#pragma GCC ivdep
        for (int x = 0; x < width + 2 * kRadius; ++x) sum[x] = a[x] + b[x] + c[x] + d[x] + e[x];
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
void evidence_of(const EvidenceCell& cell, int groups, const kde::EvidenceParameters& parameters,
                 const LightAround& light, const float* log_lit, const float* log_foreground,
                 const EvidenceRows& out) {
    each_vector(groups, [&](int x) HWY_ATTR {
        evidence_at<kChannels>(cell, parameters, light, log_lit, log_foreground, out, x);
    });
}

void evidence_cell(const EvidenceCell& cell, int groups, const kde::EvidenceParameters& parameters,
                   const LightAround& light, const float* log_lit, const float* log_foreground,
                   const EvidenceRows& out) {
    if (cell.channels == 1)
        evidence_of<1>(cell, groups, parameters, light, log_lit, log_foreground, out);
    else
        evidence_of<3>(cell, groups, parameters, light, log_lit, log_foreground, out);
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
KINEVOX_EXPORT(fit_light_cell);
KINEVOX_EXPORT(neighbourhood_light);
KINEVOX_EXPORT(evidence_cell);
KINEVOX_EXPORT(smooth_row);
KINEVOX_EXPORT(decide_row);

void fit_light_cell(const EvidenceCell& cell, int groups, const kde::EvidenceParameters& parameters,
                    const LightRows& out) {
    KINEVOX_DISPATCH(fit_light_cell)(cell, groups, parameters, out);
}
void neighbourhood_light(const float* weighted_value, const float* weighted_energy, std::ptrdiff_t stride,
                         int width, float* light) {
    KINEVOX_DISPATCH(neighbourhood_light)(weighted_value, weighted_energy, stride, width, light);
}
void evidence_cell(const EvidenceCell& cell, int groups, const kde::EvidenceParameters& parameters,
                   const LightAround& light, const float* log_lit, const float* log_foreground,
                   const EvidenceRows& out) {
    KINEVOX_DISPATCH(evidence_cell)(cell, groups, parameters, light, log_lit, log_foreground, out);
}
void smooth_row(const float* const rows[5], const float weights[5], int width, float* scratch, float* out) {
    KINEVOX_DISPATCH(smooth_row)(rows, weights, width, scratch, out);
}
void decide_row(const float* evidence, int width, const Decision& decision, std::uint8_t* probability,
                std::uint8_t* sharp, std::uint8_t* loose) {
    KINEVOX_DISPATCH(decide_row)(evidence, width, decision, probability, sharp, loose);
}
}  // namespace kinevox::kernels::cpu
#endif
