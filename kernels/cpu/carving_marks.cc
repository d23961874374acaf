#include "kernels/cpu/carving_marks.h"

#include <bit>
#include <cstddef>

#include "kernels/cpu/sixteen_lanes.h"
#include "kernels/shared/hull.h"

namespace kinevox::kernels {
namespace {

// True if every ray through the voxel keeps enough of the volume without it.
bool spare(const CarvingEvidence& evidence, int n) {
    for (const ViewOfVolume& view : evidence.views) {
        const int cell = view.cell[n];
        if (cell >= 0 && view.depths[cell].between_m() < evidence.min_ray_length_m) return false;
    }
    return true;
}

bool colours_differ(const CarvingEvidence& evidence, const Surface& surface, int n) {
    const CellColour* seen[kMaxViews];
    int count = 0;
    for (std::size_t v = 0; v < evidence.views.size(); ++v) {
        const ViewOfVolume& view = evidence.views[v];
        if (evidence.colours[v].cells.empty() || !sees(view, n, surface.open[n])) continue;
        const CellColour& colour = evidence.colours[v].cells[view.cell[n]];
        for (int other = 0; other < count; ++other) {
            if (disagree(colour, *seen[other])) return true;
        }
        seen[count++] = &colour;
    }
    return false;
}

void mark_plain(const CarvingEvidence& evidence, const Surface& surface, int first, int last,
                const std::uint64_t* unsupported, std::uint64_t* marks) {
    for (int n = first; n < last; ++n) {
        const int bit = surface.bit[n];
        const bool is_thin = unsupported[bit >> 6] >> (bit & 63) & 1;
        if (spare(evidence, n) && (is_thin || colours_differ(evidence, surface, n)))
            marks[bit >> 6] |= std::uint64_t{1} << (bit & 63);
    }
}

#ifdef KINEVOX_HAVE_AVX2_FORM
// The same for eight voxels at a time without branches, which would be unpredictable.
class EightVoxels {
  public:
    // Of the voxels n .. n + 7 those below `last`.
    KINEVOX_AVX2 EightVoxels(const CarvingEvidence& evidence, const Surface& surface, int n, int last)
        : evidence_(evidence),
          n_(n),
          here_(_mm256_cmpgt_epi32(_mm256_set1_epi32(last - n), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7))),
          open_(_mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(&surface.open[n])))) {}

    KINEVOX_AVX2 __m256i spare() {
        const __m256 keep = _mm256_set1_ps(evidence_.min_ray_length_m), sign = _mm256_set1_ps(-0.f);
        __m256 spare = _mm256_castsi256_ps(here_);
        views_ = 0;
        for (std::size_t v = 0; v < evidence_.views.size(); ++v) {
            const ViewOfVolume& view = evidence_.views[v];
            if (view.depths.empty()) continue;  // sees nothing
            const __m256i cell = load(&view.cell[n_]);
            const __m256i in_image = _mm256_and_si256(here_, _mm256_cmpgt_epi32(cell, _mm256_set1_epi32(-1)));
            const __m256i at = _mm256_and_si256(cell, in_image);
            const float* depths = &view.depths[0].front_m;
            const __m256 front = _mm256_i32gather_ps(depths, at, sizeof(DepthCell));
            const __m256 minus_back = _mm256_i32gather_ps(depths + 1, at, sizeof(DepthCell));
            const __m256 between = _mm256_sub_ps(_mm256_xor_ps(minus_back, sign), front);
            const __m256 in = _mm256_castsi256_ps(in_image);
            spare = _mm256_andnot_ps(_mm256_and_ps(in, _mm256_cmp_ps(between, keep, _CMP_LT_OQ)), spare);
            if (evidence_.colours[v].cells.empty()) continue;
            const __m256 behind = _mm256_i32gather_ps(view.behind_m.data(), open_, sizeof(float));
            const __m256 depth = _mm256_loadu_ps(&view.depth_m[n_]);
            at_[views_] = at;
            sees_[views_] = _mm256_castps_si256(
                _mm256_and_ps(in, _mm256_cmp_ps(depth, _mm256_add_ps(front, behind), _CMP_LE_OQ)));
            cells_[views_++] = evidence_.colours[v].cells.data();
        }
        return _mm256_castps_si256(spare);
    }

    // After spare().
    KINEVOX_AVX2 __m256i colours_differ() const {
        const __m256i bgr = _mm256_set1_epi32(0x00ffffff);
        __m256i mean[kMaxViews], limit[kMaxViews], sees[kMaxViews], any = _mm256_setzero_si256();
        int count = 0;
        for (int v = 0; v < views_; ++v) {
            if (_mm256_testz_si256(sees_[v], sees_[v])) continue;
            const int* cells = reinterpret_cast<const int*>(cells_[v]);
            mean[count] = _mm256_and_si256(_mm256_i32gather_epi32(cells, at_[v], sizeof(CellColour)), bgr);
            limit[count] =
                _mm256_and_si256(_mm256_i32gather_epi32(cells + 1, at_[v], sizeof(CellColour)), bgr);
            sees[count] = sees_[v];
            for (int other = 0; other < count; ++other) {
                const __m256i gap = _mm256_sub_epi8(_mm256_max_epu8(mean[count], mean[other]),
                                                    _mm256_min_epu8(mean[count], mean[other]));
                const __m256i beyond = _mm256_subs_epu8(gap, _mm256_max_epu8(limit[count], limit[other]));
                const __m256i equal = _mm256_cmpeq_epi32(beyond, _mm256_setzero_si256());
                any = _mm256_or_si256(any,
                                      _mm256_andnot_si256(equal, _mm256_and_si256(sees[count], sees[other])));
            }
            ++count;
        }
        return any;
    }

    KINEVOX_AVX2 static __m256i load(const void* from) {
        return _mm256_loadu_si256(static_cast<const __m256i*>(from));
    }

  private:
    const CarvingEvidence& evidence_;
    const int n_;
    const __m256i here_, open_;
    int views_ = 0;  // that have colours
    __m256i at_[kMaxViews], sees_[kMaxViews];
    const CellColour* cells_[kMaxViews];
};

KINEVOX_AVX2 void mark_avx2(const CarvingEvidence& evidence, const Surface& surface, int first, int last,
                            const std::uint64_t* unsupported, std::uint64_t* marks) {
    static_assert(offsetof(CellColour, limit) == 4 && sizeof(CellColour) == 8 && sizeof(DepthCell) == 8);
    for (int n = first; n < last; n += kLanes) {
        EightVoxels voxels(evidence, surface, n, last);
        const unsigned spare = _mm256_movemask_ps(_mm256_castsi256_ps(voxels.spare()));
        if (spare == 0) continue;
        const __m256i bits =
            _mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(&surface.bit[n])));
        const __m256i bit =
            _mm256_and_si256(bits, _mm256_set1_epi32(kBrickVoxels - 1));  // the last lanes may be unused
        const __m256i word =
            _mm256_i32gather_epi32(reinterpret_cast<const int*>(unsupported), _mm256_srli_epi32(bit, 5), 4);
        // The voxel's own bit becomes the sign.
        const __m256i to_sign =
            _mm256_sub_epi32(_mm256_set1_epi32(31), _mm256_and_si256(bit, _mm256_set1_epi32(31)));
        unsigned goes = _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_sllv_epi32(word, to_sign)));
        if (spare & ~goes) goes |= _mm256_movemask_ps(_mm256_castsi256_ps(voxels.colours_differ()));
        for (goes &= spare; goes; goes &= goes - 1) {
            const int at = surface.bit[n + std::countr_zero(goes)];
            marks[at >> 6] |= std::uint64_t{1} << (at & 63);
        }
    }
}

// As EightVoxels.
class SixteenVoxels {
  public:
    KINEVOX_AVX512 SixteenVoxels(const CarvingEvidence& evidence, const Surface& surface, int n, int last)
        : evidence_(evidence),
          n_(n),
          here_(static_cast<__mmask16>(last - n < 16 ? (1u << (last - n)) - 1 : 0xffff)),
          open_(_mm512_maskz_cvtepu8_epi32(here_, _mm_maskz_loadu_epi8(here_, &surface.open[n]))) {}

    KINEVOX_AVX512 __mmask16 spare() {
        const __m512 keep = _mm512_set1_ps(evidence_.min_ray_length_m), sign = _mm512_set1_ps(-0.f);
        unsigned spare = here_;
        views_ = 0;
        for (std::size_t v = 0; v < evidence_.views.size(); ++v) {
            const ViewOfVolume& view = evidence_.views[v];
            if (view.depths.empty()) continue;  // sees nothing
            const __m512i cell = _mm512_maskz_loadu_epi32(here_, &view.cell[n_]);
            const __mmask16 in_image = _mm512_mask_cmpge_epi32_mask(here_, cell, _mm512_setzero_si512());
            const sixteen::Pairs depths = sixteen::gather_pairs(view.depths.data(), cell, in_image);
            const __m512 front = _mm512_castsi512_ps(depths.first);
            const __m512 back = _mm512_xor_ps(_mm512_castsi512_ps(depths.second), sign);
            spare &= ~_mm512_mask_cmp_ps_mask(in_image, _mm512_sub_ps(back, front), keep, _CMP_LT_OQ);
            if (evidence_.colours[v].cells.empty()) continue;
            const __m512 depth = _mm512_maskz_loadu_ps(here_, &view.depth_m[n_]);
            at_[views_] = cell;
            sees_[views_] = _mm512_mask_cmp_ps_mask(
                in_image, depth, _mm512_add_ps(front, sixteen::look_up(view.behind_m.data(), open_)),
                _CMP_LE_OQ);
            cells_[views_++] = evidence_.colours[v].cells.data();
        }
        return static_cast<__mmask16>(spare);
    }

    // After spare(), for the voxels in `asked`.
    KINEVOX_AVX512 __mmask16 colours_differ(unsigned asked) const {
        const __m512i bgr = _mm512_set1_epi32(0x00ffffff);
        __m512i mean[kMaxViews], limit[kMaxViews];
        __mmask16 sees[kMaxViews];
        unsigned any = 0;
        int count = 0;
        for (int v = 0; v < views_; ++v) {
            sees[count] = static_cast<__mmask16>(sees_[v] & asked);
            if (sees[count] == 0) continue;
            const sixteen::Pairs colour = sixteen::gather_pairs(cells_[v], at_[v], sees[count]);
            mean[count] = _mm512_and_si512(colour.first, bgr);
            limit[count] = _mm512_and_si512(colour.second, bgr);
            for (int other = 0; other < count; ++other) {
                const __m512i gap = _mm512_sub_epi8(_mm512_max_epu8(mean[count], mean[other]),
                                                    _mm512_min_epu8(mean[count], mean[other]));
                const __m512i beyond = _mm512_subs_epu8(gap, _mm512_max_epu8(limit[count], limit[other]));
                any |= _mm512_mask_test_epi32_mask(static_cast<__mmask16>(sees[count] & sees[other]), beyond,
                                                   beyond);
            }
            ++count;
        }
        return static_cast<__mmask16>(any);
    }

  private:
    const CarvingEvidence& evidence_;
    const int n_;
    const __mmask16 here_;
    const __m512i open_;
    int views_ = 0;  // that have colours
    __m512i at_[kMaxViews];
    __mmask16 sees_[kMaxViews];
    const CellColour* cells_[kMaxViews];
};

KINEVOX_AVX512 void mark_avx512(const CarvingEvidence& evidence, const Surface& surface, int first, int last,
                                const std::uint64_t* unsupported, std::uint64_t* marks) {
    const __m512i words = _mm512_loadu_si512(unsupported);
    for (int n = first; n < last; n += 16) {
        SixteenVoxels voxels(evidence, surface, n, last);
        const unsigned spare = voxels.spare();
        if (spare == 0) continue;
        const __m512i bit = _mm512_cvtepu16_epi32(_mm256_maskz_loadu_epi16(spare, &surface.bit[n]));
        const __m512i word = _mm512_permutexvar_epi32(_mm512_srli_epi32(bit, 5), words);
        const __m512i own =
            _mm512_sllv_epi32(_mm512_set1_epi32(1), _mm512_and_si512(bit, _mm512_set1_epi32(31)));
        unsigned goes = _mm512_mask_test_epi32_mask(spare, word, own);
        if (spare != goes) goes |= voxels.colours_differ(spare & ~goes);
        for (; goes; goes &= goes - 1) {
            const int at = surface.bit[n + std::countr_zero(goes)];
            marks[at >> 6] |= std::uint64_t{1} << (at & 63);
        }
    }
}
#endif

}  // namespace

void mark_voxels(const CarvingEvidence& evidence, const Surface& surface, int first, int last,
                 const std::uint64_t* unsupported, std::uint64_t* marks) {
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx512()) return mark_avx512(evidence, surface, first, last, unsupported, marks);
    if (have_avx2()) return mark_avx2(evidence, surface, first, last, unsupported, marks);
#endif
    mark_plain(evidence, surface, first, last, unsupported, marks);
}

}  // namespace kinevox::kernels
