#include "kernels/cpu/shadow_group.h"

#include <cstring>

#include "kernels/cpu/dispatch.h"
#include "kernels/cpu/segmentation_evidence.h"

#ifdef KINEVOX_HAVE_HIGHWAY
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/cpu/shadow_group.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
HWY_BEFORE_NAMESPACE();
#endif

#ifndef KINEVOX_SHADOW_FLOATS
#define KINEVOX_SHADOW_FLOATS
#ifdef __clang__
// Clang refuses vectors that are wider than the registers of the file's options as arguments.
namespace kinevox::kernels::cpu {
using ShadowFloats = float;
inline constexpr int kShadowLanes = 1;
}  // namespace kinevox::kernels::cpu
#else
namespace kinevox::kernels::cpu {
// 16 pixels; the compiler splits them into the registers that there are.
using ShadowFloats = float __attribute__((vector_size(64)));
inline constexpr int kShadowLanes = 16;
using ShadowIntegers = std::int32_t __attribute__((vector_size(64)));
}  // namespace kinevox::kernels::cpu
namespace kinevox::kernels::kde {
template <>
struct IntegersOf<cpu::ShadowFloats> {
    using Type = cpu::ShadowIntegers;
};
}  // namespace kinevox::kernels::kde
#endif
#endif

namespace kinevox::kernels::cpu::HWY_NAMESPACE {

using kde::kCellPixels;
using kde::kGroupPixels;
using kde::kPatchRadius;

// The values of a group's blocks of kWidth pixels, for kShadowLanes pixels from `first` on.
template <int kWidth>
ShadowFloats spread(const float* of_block, [[maybe_unused]] int first) {
#ifdef __clang__
    return of_block[first / kWidth];
#else
    static_assert(kShadowLanes == kGroupPixels);
    ShadowIntegers block;
    for (int lane = 0; lane < kGroupPixels; ++lane) block[lane] = lane / kWidth;
    return __builtin_shuffle(kde::load<ShadowFloats>(of_block), block);
#endif
}

template <int kChannels>
void group_of(const kde::ShadowRule& rule, ShadowGroup& group) {
    for (int i = 0; i < kGroupPixels; i += kShadowLanes) {
        const kde::ShadowPixels& p = group.pixels;
        auto e = kde::own_evidence<kChannels, ShadowFloats>(
            kde::load<ShadowFloats>(group.distance + i), kde::load<ShadowFloats>(group.colour + i),
            {p.factor + i, p.residual + i, p.neighbourhood + i, p.misfit + i, p.stride}, group.noise_factor);
        for (int n = 0; n < group.view_count; ++n)
            kde::add_floor_light(e, spread<kde::kFloorBlock_px>(group.floor_light[n], i));
        e.support = spread<kde::kSupportBlock_px>(group.support, i);
        const auto odds = kde::shadow_log_odds(e, rule);
        std::memcpy(group.own + i, &odds.own, sizeof odds.own);
        std::memcpy(group.voted + i, &odds.voted, sizeof odds.voted);
        if (!group.with_features) continue;
        ShadowFloats features[kde::kShadowFeatures];
        kde::shadow_features(e, features);
        for (int n = 0; n < kde::kShadowFeatures; ++n)
            std::memcpy(group.features[n] + i, &features[n], sizeof features[n]);
    }
}

unsigned doubtful_pixels(const std::uint8_t* density, const float* evidence) {
    std::uint8_t doubtful[kGroupPixels];
    for (int i = 0; i < kGroupPixels; ++i)
        doubtful[i] = static_cast<std::uint8_t>((density[i] < kde::kSureDensity) &
                                                (evidence[i] < kde::kDoubtfulEvidence));
    // Eight bytes of 0 or 1 to eight bits.
    unsigned mask = 0;
    for (int half = 0; half < 2; ++half) {
        std::uint64_t bytes;
        std::memcpy(&bytes, doubtful + 8 * half, sizeof bytes);
        mask |= static_cast<unsigned>(bytes * 0x0102040810204080u >> 56) << 8 * half;
    }
    return mask;
}

void shadow_group(int channels, const kde::ShadowRule& rule, ShadowGroup& group) {
    if (channels == 1)
        group_of<1>(rule, group);
    else
        group_of<3>(rule, group);
}

void misfit_row(const float* product, const float* energy, const float* square, std::ptrdiff_t stride,
                int width, int channels, float* misfit) {
    constexpr int kColumns = 2 * kPatchRadius;
    float sums[3][kMaxRowPixels + kColumns];
    const auto columns = [&](const float* plane, float* sum) {
        const float* first = plane - kPatchRadius * stride - kPatchRadius;
        const float *a = first, *b = a + stride, *c = b + stride, *d = c + stride, *e = d + stride,
                    *f = e + stride, *g = f + stride;
#pragma GCC ivdep
        for (int x = 0; x < width + kColumns; ++x) sum[x] = a[x] + b[x] + c[x] + d[x] + e[x] + f[x] + g[x];
    };
    columns(product, sums[0]);
    columns(energy, sums[1]);
    columns(square, sums[2]);
    const auto along = [](const float* sum, int x) {
        return sum[x] + sum[x + 1] + sum[x + 2] + sum[x + 3] + sum[x + 4] + sum[x + 5] + sum[x + 6];
    };
    const float per_value = 1.0f / static_cast<float>(49 * channels);
    float* __restrict out = misfit;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        const float p = along(sums[0], x), e = along(sums[1], x), s = along(sums[2], x);
        const float left = (s - p * p / (e > 1e-6f ? e : 1e-6f)) * per_value;
        out[x] = left > 0 ? left : 0;
    }
}

}  // namespace kinevox::kernels::cpu::HWY_NAMESPACE

#ifdef KINEVOX_HAVE_HIGHWAY
HWY_AFTER_NAMESPACE();
#endif

#if !defined(KINEVOX_HAVE_HIGHWAY) || HWY_ONCE
namespace kinevox::kernels::cpu {
KINEVOX_EXPORT(doubtful_pixels);
KINEVOX_EXPORT(shadow_group);
KINEVOX_EXPORT(misfit_row);

unsigned doubtful_pixels(const std::uint8_t* density, const float* evidence) {
    return KINEVOX_DISPATCH(doubtful_pixels)(density, evidence);
}
void shadow_group(int channels, const kde::ShadowRule& rule, ShadowGroup& group) {
    KINEVOX_DISPATCH(shadow_group)(channels, rule, group);
}
void misfit_row(const float* product, const float* energy, const float* square, std::ptrdiff_t stride,
                int width, int channels, float* misfit) {
    KINEVOX_DISPATCH(misfit_row)(product, energy, square, stride, width, channels, misfit);
}
}  // namespace kinevox::kernels::cpu
#endif
