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

constexpr int kGroup = 8;  // views
constexpr int kGroupBytes = kGroup * kCodeBytes;

constexpr int kPosesTogether =
    8;  // of one piece of work: codes, distances and scores of these stay in the first cache
constexpr int kPieceViews = kPosesTogether * kViewBins;
static_assert(kPieceViews % kGroup == 0);

struct Placed {  // a query with its place among the bins, for even and odd headings
    const MomentSlab* slab;
    const std::uint8_t* code;
    int first[2];
    float share[2];
};

KINEVOX_INLINE void distances_body(const std::uint8_t* blocks, int groups, const std::uint8_t* code,
                                   std::int32_t* out) {
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
KINEVOX_AVX2 inline void distances_avx2(const std::uint8_t* blocks, int groups, const std::uint8_t* code,
                                        std::int32_t* out) {
    const __m256i ones = _mm256_set1_epi16(1);
    __m256i query[kCodeBytes / 4];
    for (int n = 0; n < kCodeBytes / 4; ++n) {
        std::int32_t four;
        std::memcpy(&four, code + 4 * n, 4);
        query[n] = _mm256_set1_epi32(four);
    }
    for (int g = 0; g < groups; ++g) {
        const auto* views =
            reinterpret_cast<const __m256i*>(blocks + static_cast<std::ptrdiff_t>(g) * kGroupBytes);
        __m256i sum = _mm256_setzero_si256();
        for (int n = 0; n < kCodeBytes / 4; ++n) {
            const __m256i view = _mm256_loadu_si256(views + n);
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

// Adds one camera's part to the scores of one pose; its views lie twice around, so that no index wraps.
KINEVOX_INLINE void interpolate_body(const std::int32_t* distances, const float* neighbours,
                                     const Placed& query, float weight, float* even, float* odd) {
    float d[2 * kViewBins + 1], n[2 * kViewBins];
    for (int bin = 0; bin < kViewBins; ++bin)
        d[bin] = d[bin + kViewBins] = static_cast<float>(distances[bin]);
    d[2 * kViewBins] = d[0];
    for (int bin = 0; bin < kViewBins; ++bin) n[bin] = n[bin + kViewBins] = neighbours[bin];
    for (int half = 0; half < 2; ++half) {
        const float b = weight * query.share[half], a = weight - b, c = b * (1 - query.share[half]);
        const float* dd = d + query.first[half];
        const float* nn = n + query.first[half];
        float* to = half == 0 ? even : odd;
        for (int bin = 0; bin < kViewBins; ++bin) to[bin] += a * dd[bin] + b * dd[bin + 1] - c * nn[bin];
    }
}

template <class Distances>
KINEVOX_INLINE void score_body(std::span<const Placed> queries, std::span<float> scores,
                               Distances distances) {
    const float weight = 1.f / static_cast<float>(queries.size());
    const int poses = queries[0].slab->poses;
    std::int32_t piece[kPieceViews];
    float even[kPosesTogether][kViewBins], odd[kPosesTogether][kViewBins];
    for (int first = 0; first < poses; first += kPosesTogether) {
        const int count = poses - first < kPosesTogether ? poses - first : kPosesTogether;
        const std::ptrdiff_t view = static_cast<std::ptrdiff_t>(first) * kViewBins;
        std::memset(even, 0, sizeof even);
        std::memset(odd, 0, sizeof odd);
        for (const Placed& query : queries) {
            distances(query.slab->blocks.data() + view * kCodeBytes,
                      (count * kViewBins + kGroup - 1) / kGroup, query.code, piece);
            for (int n = 0; n < count; ++n)
                interpolate_body(piece + n * kViewBins, query.slab->neighbours.data() + view + n * kViewBins,
                                 query, weight, even[n], odd[n]);
        }
        for (int n = 0; n < count; ++n) {
            float* to = scores.data() + static_cast<std::ptrdiff_t>(first + n) * kHeadings;
            for (int bin = 0; bin < kViewBins; ++bin)
                to[2 * bin] = even[n][bin], to[2 * bin + 1] = odd[n][bin];
        }
    }
}

void score_plain(std::span<const Placed> queries, std::span<float> scores) {
    score_body(queries, scores, distances_body);
}
#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2 void score_avx2(std::span<const Placed> queries, std::span<float> scores) {
    score_body(queries, scores, distances_avx2);
}
#endif

KINEVOX_INLINE float blended_distance_body(const float* query, const std::int16_t* a, const std::int16_t* b,
                                           float weight_a, float weight_b, int values) {
    typedef std::int16_t Shorts __attribute__((vector_size(16)));
    Floats sums{};
    int v = 0;
    for (; v + kLanes <= values; v += kLanes) {
        Floats q;
        Shorts sa, sb;
        std::memcpy(&q, query + v, sizeof q);
        std::memcpy(&sa, a + v, sizeof sa);
        std::memcpy(&sb, b + v, sizeof sb);
        const Floats d = q - weight_a * __builtin_convertvector(sa, Floats) -
                         weight_b * __builtin_convertvector(sb, Floats);
        sums += d * d;
    }
    float sum = ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7]));
    for (; v < values; ++v) {
        const float d = query[v] - weight_a * static_cast<float>(a[v]) - weight_b * static_cast<float>(b[v]);
        sum += d * d;
    }
    return sum;
}

#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2 float blended_distance_avx2(const float* query, const std::int16_t* a, const std::int16_t* b,
                                         float weight_a, float weight_b, int values) {
    return blended_distance_body(query, a, b, weight_a, weight_b, values);
}
#endif

}  // namespace

float blended_distance(const float* query, const std::int16_t* a, const std::int16_t* b, float weight_a,
                       float weight_b, int values) {
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) return blended_distance_avx2(query, a, b, weight_a, weight_b, values);
#endif
    return blended_distance_body(query, a, b, weight_a, weight_b, values);
}

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
            if (code[n] > kCodeMax)
                throw std::invalid_argument("moment search: a code's numbers are 0 to 127");
            slab.blocks[static_cast<std::size_t>(view / kGroup) * kGroupBytes + n / 4 * 32 +
                        view % kGroup * 4 + n % 4] = code[n];
            sum += (code[n] - next[n]) * (code[n] - next[n]);
        }
        slab.neighbours[view] = static_cast<float>(sum);
    }
    return slab;
}

void score_headings(std::span<const MomentQuery> queries, std::span<float> scores) {
    if (queries.empty()) throw std::invalid_argument("moment search: no camera");
    std::vector<Placed> placed;
    for (const MomentQuery& query : queries) {
        if (scores.size() != static_cast<std::size_t>(query.slab->poses) * kHeadings ||
            !std::isfinite(query.first_bin))
            throw std::invalid_argument(
                "moment search: a score for each pose and heading and a finite first bin are needed");
        Placed& at = placed.emplace_back(Placed{query.slab, query.code, {}, {}});
        for (int half = 0; half < 2; ++half) {
            double place = std::fmod(query.first_bin + 0.5 * half, kViewBins);
            if (place < 0) place += kViewBins;
            at.first[half] = static_cast<int>(place) % kViewBins;
            at.share[half] = static_cast<float>(place - std::floor(place));
        }
    }
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) return score_avx2(placed, scores);
#endif
    score_plain(placed, scores);
}

}  // namespace kinevox::kernels
