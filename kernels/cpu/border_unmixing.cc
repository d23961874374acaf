#include "kernels/cpu/border_unmixing.h"

#include <array>
#include <cstring>

#include "kernels/cpu/simd.h"

#ifdef KINEVOX_HAVE_AVX2_FORM
#include <immintrin.h>
#endif

namespace kinevox::kernels::cpu {
namespace {

using kde::kBorderRadius;

// The first border pixel of [x, x1), or x1; most of a row has none.
inline int next_border(const std::uint8_t* zones, int x, int x1) {
    const void* found =
        x < x1 ? std::memchr(zones + x, kde::kZoneBorder, static_cast<std::size_t>(x1 - x)) : nullptr;
    return found ? static_cast<int>(static_cast<const std::uint8_t*>(found) - zones) : x1;
}

template <int kChannels>
void unmix_plain(const BorderImages& p, int y, int x0, int x1, std::uint8_t* sharp) {
    const std::uint8_t* const zones = p.zones + static_cast<std::ptrdiff_t>(y) * p.width;
    for (int x = next_border(zones, x0, x1); x < x1; x = next_border(zones, x + 1, x1)) {
        const int part = kde::unmix_border_pixel<kChannels>(x, y, p.width, p.limit, p.zones, p.values,
                                                            p.reference, p.cells_per_row, p.parameters);
        if (part >= 0) sharp[x] = part ? 255 : 0;
    }
}

#ifdef KINEVOX_HAVE_AVX2_FORM
// The weights of a window's rows for eight pixels starting kBorderRadius to the left; 0 on the other colour
// of the chessboard and after the window.
using Weights = std::array<std::array<std::int16_t, 8>, 2 * kBorderRadius + 1>;
constexpr Weights weights_of(int odd) {
    Weights weights{};
    for (int dy = -kBorderRadius; dy <= kBorderRadius; ++dy)
        for (int dx = -kBorderRadius; dx <= kBorderRadius; ++dx)
            if (((dx + dy) & 1) == odd)
                weights[dy + kBorderRadius][dx + kBorderRadius] =
                    static_cast<std::int16_t>(kde::border_weight(dx, dy));
    return weights;
}
constexpr Weights kWeights[2] = {weights_of(0),
                                 weights_of(1)};  // of a pixel on the one colour and on the other
static_assert(kde::kWeightOne * 255 < 32768);

KINEVOX_AVX2 KINEVOX_INLINE __m128i eight(const std::uint8_t* from) {
    return _mm_cvtepu8_epi16(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(from)));
}

KINEVOX_AVX2 KINEVOX_INLINE int sum_of(__m128i four) {
    four = _mm_add_epi32(four, _mm_shuffle_epi32(four, 0x4e));
    return _mm_cvtsi128_si32(_mm_add_epi32(four, _mm_shuffle_epi32(four, 0xb1)));
}

// kde::sum_around() of a pixel whose window, one column more to the right, is inside the limit and one cell.
KINEVOX_AVX2 KINEVOX_INLINE kde::BorderSums<3> sum_window(const BorderImages& p, int x, int y) {
    constexpr int kPlane = kde::kCellPixels;
    const Weights& weights =
        kWeights[(x + y) & 1];  // the fields that count have an even sum of column and row
    const __m128i zero = _mm_setzero_si128(), one = _mm_set1_epi16(1);
    const __m128i inside_zone = _mm_set1_epi16(kde::kZoneInside),
                  outside_zone = _mm_set1_epi16(kde::kZoneOutside);
    __m128i subject[3] = {zero, zero, zero}, weight = zero, product = zero, energy = zero;
    const std::uint8_t* zones =
        p.zones + static_cast<std::ptrdiff_t>(y - kBorderRadius) * p.width + x - kBorderRadius;
    const long long first = kde::border_offset<3>(x - kBorderRadius, y - kBorderRadius, p.cells_per_row);
    const long long row_bytes = static_cast<long long>(p.cells_per_row) * 3 * kPlane;
    const std::uint8_t *values = p.values + first, *reference = p.reference + first;
    for (const auto& row : weights) {
        const __m128i w = _mm_loadu_si128(reinterpret_cast<const __m128i*>(row.data()));
        const __m128i zone = eight(zones);
        const __m128i inside = _mm_and_si128(w, _mm_cmpeq_epi16(zone, inside_zone));
        const __m128i outside = _mm_and_si128(w, _mm_cmpeq_epi16(zone, outside_zone));
        weight = _mm_add_epi32(weight, _mm_madd_epi16(inside, one));
        for (int c = 0; c < 3; ++c) {
            const __m128i v = eight(values + c * kPlane), r = eight(reference + c * kPlane);
            subject[c] = _mm_add_epi32(subject[c], _mm_madd_epi16(inside, v));
            const __m128i level = _mm_mullo_epi16(outside, r);
            product = _mm_add_epi32(product, _mm_madd_epi16(level, v));
            energy = _mm_add_epi32(energy, _mm_madd_epi16(level, r));
        }
        zones += p.width, values += row_bytes, reference += row_bytes;
    }
    kde::BorderSums<3> sums;
    for (int c = 0; c < 3; ++c) sums.subject[c] = sum_of(subject[c]);
    sums.subject_weight = sum_of(weight), sums.product = sum_of(product), sums.energy = sum_of(energy);
    return sums;
}

KINEVOX_AVX2 void unmix_avx2(const BorderImages& p, int y, int x0, int x1, std::uint8_t* sharp) {
    const bool rows_inside = y - kBorderRadius >= p.limit.y0 && y + kBorderRadius < p.limit.y1;
    const std::uint8_t* const zones = p.zones + static_cast<std::ptrdiff_t>(y) * p.width;
    for (int x = next_border(zones, x0, x1); x < x1; x = next_border(zones, x + 1, x1)) {
        const int left = x - kBorderRadius, right = x + kBorderRadius + 1;
        const bool whole = rows_inside && left >= p.limit.x0 && right < p.limit.x1 &&
                           left / kde::kCellPixels == right / kde::kCellPixels;
        const long long at = kde::border_offset<3>(x, y, p.cells_per_row);
        const int part =
            whole ? kde::unmix<3>(sum_window(p, x, y), p.values + at, p.reference + at, p.parameters)
                  : kde::unmix_border_pixel<3>(x, y, p.width, p.limit, p.zones, p.values, p.reference,
                                               p.cells_per_row, p.parameters);
        if (part >= 0) sharp[x] = part ? 255 : 0;
    }
}
#endif

}  // namespace

void unmix_row(const BorderImages& images, int y, int x0, int x1, std::uint8_t* sharp) {
    if (images.channels == 1) return unmix_plain<1>(images, y, x0, x1, sharp);
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) return unmix_avx2(images, y, x0, x1, sharp);
#endif
    unmix_plain<3>(images, y, x0, x1, sharp);
}

}  // namespace kinevox::kernels::cpu
