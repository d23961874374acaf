// Sixteen lanes at a time, for the loops that AVX-512 makes clearly faster; have_avx512() picks at run time.
// Only where KINEVOX_HAVE_AVX2_FORM is defined.
#pragma once

#include "kernels/cpu/simd.h"
#include "kernels/shared/camera.h"

#ifdef KINEVOX_HAVE_AVX2_FORM
// GCC 12 warns of what its own intrinsics leave undefined on purpose.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"
#include <immintrin.h>
#pragma GCC diagnostic pop

#define KINEVOX_SIXTEEN KINEVOX_AVX512 inline __attribute__((always_inline))

namespace kinevox::kernels::sixteen {

KINEVOX_SIXTEEN __m512 all(float value) {
    return _mm512_set1_ps(value);
}
KINEVOX_SIXTEEN __m512i all(int value) {
    return _mm512_set1_epi32(value);
}

struct Pixels {
    __m512 u, v;     // px, within +-30000
    __mmask16 seen;  // where the camera looks that way
};

KINEVOX_SIXTEEN __m512 limited(__m512 u) {
    return _mm512_min_ps(_mm512_max_ps(u, all(-30000.f)), all(30000.f));  // a NaN becomes the least
}

// As project_lanes(), with the products fused as the compiler fuses them there: the same bits.
KINEVOX_SIXTEEN Pixels project(const Projector& c, __m512 px, __m512 py, __m512 pz) {
    const __m512 w = _mm512_div_ps(all(1.f), pz);
    __m512 x = _mm512_mul_ps(px, w), y = _mm512_mul_ps(py, w);
    const __m512 r2 = _mm512_fmadd_ps(x, x, _mm512_mul_ps(y, y));
    const __mmask16 seen = _mm512_mask_cmp_ps_mask(_mm512_cmp_ps_mask(pz, all(kNearest_m), _CMP_GT_OQ), r2,
                                                   all(c.max_radius2), _CMP_LT_OQ);
    if (c.distorted) {
        const __m512 xy = _mm512_mul_ps(x, y);
        __m512 radial = _mm512_fmadd_ps(all(c.k3), r2, all(c.k2));
        radial = _mm512_fmadd_ps(_mm512_fmadd_ps(radial, r2, all(c.k1)), r2, all(1.f));
        const __m512 across = _mm512_fmadd_ps(_mm512_add_ps(x, x), x, r2),
                     down = _mm512_fmadd_ps(_mm512_add_ps(y, y), y, r2);
        x = _mm512_fmadd_ps(all(c.p2), across, _mm512_fmadd_ps(x, radial, _mm512_mul_ps(all(2 * c.p1), xy)));
        y = _mm512_fmadd_ps(all(2 * c.p2), xy, _mm512_fmadd_ps(y, radial, _mm512_mul_ps(all(c.p1), down)));
    }
    return {limited(_mm512_fmadd_ps(all(c.fx), x, all(c.cx))),
            limited(_mm512_fmadd_ps(all(c.fy), y, all(c.cy))), seen};
}

// lane_index()
KINEVOX_SIXTEEN __m512i index(__m512 u) {
    return _mm512_sub_epi32(_mm512_cvttps_epi32(_mm512_add_ps(u, all(32768.5f))), all(32768));
}

// Two 32-bit values of each of 16 elements of 8 bytes.
struct Pairs {
    __m512i first, second;
};

// Of the elements of `table` at `index`, for the lanes in `lanes`; the others are 0. One access fetches both
// values.
KINEVOX_SIXTEEN Pairs gather_pairs(const void* table, __m512i index, __mmask16 lanes) {
    const __m512i none = _mm512_setzero_si512();
    const __m512i low = _mm512_mask_i32gather_epi64(none, static_cast<__mmask8>(lanes),
                                                    _mm512_castsi512_si256(index), table, 8);
    const __m512i high = _mm512_mask_i32gather_epi64(none, static_cast<__mmask8>(lanes >> 8),
                                                     _mm512_extracti64x4_epi64(index, 1), table, 8);
    const __m512i even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
    const __m512i odd = _mm512_add_epi32(even, all(1));
    return {_mm512_permutex2var_epi32(low, even, high), _mm512_permutex2var_epi32(low, odd, high)};
}

// table[index] of 64 values.
KINEVOX_SIXTEEN __m512 look_up(const float* table, __m512i index) {
    const __m512 low = _mm512_permutex2var_ps(_mm512_loadu_ps(table), index, _mm512_loadu_ps(table + 16));
    const __m512 high =
        _mm512_permutex2var_ps(_mm512_loadu_ps(table + 32), index, _mm512_loadu_ps(table + 48));
    return _mm512_mask_blend_ps(_mm512_test_epi32_mask(index, all(32)), low, high);
}

}  // namespace kinevox::kernels::sixteen
#endif
