#include "kernels/moment_search.h"

#include <cmath>
#include <cstring>
#include <stdexcept>

#include "kernels/cpu/simd.h"
#include "kernels/shared/device.h"

#ifdef KINEVOX_HAVE_AVX2_FORM
#include <immintrin.h>
#endif

namespace kinevox::kernels {
namespace {

constexpr int kGroup = 8;        // views
constexpr int kGroupBytes = kGroup * kCodeBytes;

void distances_plain(const std::uint8_t* blocks, int groups, const std::uint8_t* code, std::int32_t* out) {
    for (int g = 0; g < groups; ++g) {
        for (int view = 0; view < kGroup; ++view) {
            std::int32_t sum = 0;
            for (int n = 0; n < kCodeBytes; ++n) {
                const int d = blocks[g * kGroupBytes + n / 4 * 32 + view * 4 + n % 4] - code[n];
                sum += d * d;
            }
            out[g * kGroup + view] = sum;
        }
    }
}

#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2 void distances_avx2(const std::uint8_t* blocks, int groups, const std::uint8_t* code, std::int32_t* out) {
    const __m256i ones = _mm256_set1_epi16(1);
    __m256i query[kCodeBytes / 4];
    for (int n = 0; n < kCodeBytes / 4; ++n) {
        std::int32_t four;
        std::memcpy(&four, code + 4 * n, 4);
        query[n] = _mm256_set1_epi32(four);
    }
    for (int g = 0; g < groups; ++g) {
        __m256i sum = _mm256_setzero_si256();
        for (int n = 0; n < kCodeBytes / 4; ++n) {
            const __m256i view =
                _mm256_loadu_si256(reinterpret_cast<const __m256i*>(blocks + static_cast<std::ptrdiff_t>(g) * kGroupBytes) + n);
            const __m256i difference =
                _mm256_or_si256(_mm256_subs_epu8(view, query[n]), _mm256_subs_epu8(query[n], view));
            // At most 127, so it may stand for the signed factor too, and two squares fit into 16 bits.
            const __m256i squares = _mm256_maddubs_epi16(difference, difference);
            sum = _mm256_add_epi32(sum, _mm256_madd_epi16(squares, ones));
        }
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(out + g * kGroup), sum);
    }
}
#endif

// Scores of one pose: D and N of its views, twice around so that no index wraps.
KINEVOX_INLINE void interpolate_body(const std::int32_t* distances, const float* neighbours, int poses,
                                     const int first[2], const float share[2], float weight, float* scores) {
    for (int pose = 0; pose < poses; ++pose) {
        float d[2 * kViewBins + 1], n[2 * kViewBins];
        const std::int32_t* from = distances + static_cast<std::ptrdiff_t>(pose) * kViewBins;
        const float* around = neighbours + static_cast<std::ptrdiff_t>(pose) * kViewBins;
        for (int bin = 0; bin < kViewBins; ++bin) d[bin] = d[bin + kViewBins] = static_cast<float>(from[bin]);
        d[2 * kViewBins] = d[0];
        for (int bin = 0; bin < kViewBins; ++bin) n[bin] = n[bin + kViewBins] = around[bin];
        float* to = scores + static_cast<std::ptrdiff_t>(pose) * kHeadings;
        float between[2][kViewBins];
        for (int half = 0; half < 2; ++half) {
            const float b = weight * share[half], a = weight - b, c = b * (1 - share[half]);
            const float* dd = d + first[half];
            const float* nn = n + first[half];
            for (int bin = 0; bin < kViewBins; ++bin)
                between[half][bin] = a * dd[bin] + b * dd[bin + 1] - c * nn[bin];
        }
        for (int bin = 0; bin < kViewBins; ++bin) {
            to[2 * bin] += between[0][bin];
            to[2 * bin + 1] += between[1][bin];
        }
    }
}

void interpolate_plain(const std::int32_t* d, const float* n, int poses, const int first[2], const float share[2],
                       float weight, float* scores) {
    interpolate_body(d, n, poses, first, share, weight, scores);
}
#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2 void interpolate_avx2(const std::int32_t* d, const float* n, int poses, const int first[2],
                                   const float share[2], float weight, float* scores) {
    interpolate_body(d, n, poses, first, share, weight, scores);
}
#endif

}  // namespace

MomentSlab MomentSlab::make(std::span<const std::uint8_t> codes) {
    if (codes.size() % (kViewBins * kCodeBytes) != 0)
        throw std::invalid_argument("moment search: codes must be whole poses");
    MomentSlab slab;
    const int views = static_cast<int>(codes.size() / kCodeBytes), groups = (views + kGroup - 1) / kGroup;
    slab.poses = views / kViewBins;
    slab.blocks.assign(static_cast<std::size_t>(groups) * kGroupBytes, 0);
    slab.neighbours.resize(views);
    for (int view = 0; view < views; ++view) {
        const std::uint8_t* code = codes.data() + static_cast<std::size_t>(view) * kCodeBytes;
        const int next_view = view % kViewBins == kViewBins - 1 ? view - kViewBins + 1 : view + 1;
        const std::uint8_t* next = codes.data() + static_cast<std::size_t>(next_view) * kCodeBytes;
        int sum = 0;
        for (int n = 0; n < kCodeBytes; ++n) {
            if (code[n] > kCodeMax) throw std::invalid_argument("moment search: a code's numbers are 0 to 127");
            slab.blocks[static_cast<std::size_t>(view / kGroup) * kGroupBytes + n / 4 * 32 + view % kGroup * 4 + n % 4] =
                code[n];
            sum += (code[n] - next[n]) * (code[n] - next[n]);
        }
        slab.neighbours[view] = static_cast<float>(sum);
    }
    return slab;
}

void score_headings(const MomentSlab& slab, const std::uint8_t code[kCodeBytes], double first_bin, float weight,
                    std::vector<std::int32_t>& scratch, std::span<float> scores) {
    if (scores.size() != static_cast<std::size_t>(slab.poses) * kHeadings || !std::isfinite(first_bin))
        throw std::invalid_argument("moment search: a score for each pose and heading and a finite first bin are needed");
    const int groups = static_cast<int>(slab.blocks.size() / kGroupBytes);
    scratch.resize(static_cast<std::size_t>(groups) * kGroup);
    int first[2];
    float share[2];
    for (int half = 0; half < 2; ++half) {
        double place = std::fmod(first_bin + 0.5 * half, kViewBins);
        if (place < 0) place += kViewBins;
        first[half] = static_cast<int>(place) % kViewBins;
        share[half] = static_cast<float>(place - std::floor(place));
    }
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) {
        distances_avx2(slab.blocks.data(), groups, code, scratch.data());
        interpolate_avx2(scratch.data(), slab.neighbours.data(), slab.poses, first, share, weight, scores.data());
        return;
    }
#endif
    distances_plain(slab.blocks.data(), groups, code, scratch.data());
    interpolate_plain(scratch.data(), slab.neighbours.data(), slab.poses, first, share, weight, scores.data());
}

}  // namespace kinevox::kernels
