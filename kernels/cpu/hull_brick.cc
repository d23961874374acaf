#include "kernels/cpu/hull.h"
#include "kernels/cpu/project_lanes.h"
#include "kernels/cpu/sixteen_lanes.h"
#include "kernels/types.h"

namespace kinevox::kernels {
namespace {

// A voxel's votes in one number: misses in the low 16 bits, the views that see it above.
constexpr int kSeen = 1 << 16;
static_assert(kMaxViews * kMissOutside < kSeen);

constexpr int kRows = kBrickEdge * kBrickEdge;

// The brick's voxels in one view, row by row along x.
struct RowPixels {
    Ints index[kRows];  // into the view's miss map
    Ints seen[kRows];   // -1 where the view sees the voxel, else 0
};

KINEVOX_INLINE Ints kept(const Ints& votes, int min_views) {
    return ((votes & (kSeen - 1)) <= kMissBudget) & (votes >= min_views * kSeen);
}

KINEVOX_INLINE bool all_out(const Ints& votes) {
    const Ints out = (votes & (kSeen - 1)) > kMissBudget;
    std::int64_t words[4];
    std::memcpy(words, &out, sizeof(words));
    return (words[0] & words[1] & words[2] & words[3]) == -1;
}

// Adds one view's votes to `rows` (a bit each); returns the rows that have voxels left.
std::uint64_t vote_plain(const std::uint8_t* miss, const RowPixels& at, std::uint64_t rows, Ints* votes) {
    std::uint64_t alive = rows;
    for (; rows; rows &= rows - 1) {
        const int row = __builtin_ctzll(rows);
        Ints here;
        for (int i = 0; i < kLanes; ++i) here[i] = miss[at.index[row][i]];
        votes[row] += at.seen[row] & (here + kSeen);
        if (all_out(votes[row])) alive &= ~(std::uint64_t{1} << row);
    }
    return alive;
}

#ifdef KINEVOX_HAVE_AVX2_FORM
// The same with a gather, which reads kMissPadding bytes beyond each pixel.
KINEVOX_AVX2 std::uint64_t vote_avx2(const std::uint8_t* miss, const RowPixels& at, std::uint64_t rows,
                                     Ints* votes) {
    std::uint64_t alive = rows;
    for (; rows; rows &= rows - 1) {
        const int row = __builtin_ctzll(rows);
        const __m256i index = _mm256_load_si256(reinterpret_cast<const __m256i*>(&at.index[row]));
        const __m256i pixels = _mm256_i32gather_epi32(reinterpret_cast<const int*>(miss), index, 1);
        const Ints here = reinterpret_cast<Ints>(pixels) & 255;
        votes[row] += at.seen[row] & (here + kSeen);
        if (all_out(votes[row])) alive &= ~(std::uint64_t{1} << row);
    }
    return alive;
}
#endif

// The voxels of eight rows that are in, of the rows that have a bit in `rows`.
std::uint64_t keep_plain(const Ints* votes, unsigned rows, int min_views) {
    std::uint64_t slice = 0;
    for (; rows; rows &= rows - 1) {
        const int row = __builtin_ctz(rows);
        const Ints in = kept(votes[row], min_views);
        for (int i = 0; i < kLanes; ++i) slice |= static_cast<std::uint64_t>(in[i] & 1) << (row * kLanes + i);
    }
    return slice;
}

#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2 std::uint64_t keep_avx2(const Ints* votes, unsigned rows, int min_views) {
    std::uint64_t slice = 0;
    for (; rows; rows &= rows - 1) {
        const int row = __builtin_ctz(rows);
        const int bits = _mm256_movemask_ps(reinterpret_cast<__m256>(kept(votes[row], min_views)));
        slice |= static_cast<std::uint64_t>(bits) << (row * kLanes);
    }
    return slice;
}
#endif

struct Form {
    std::uint64_t (*vote)(const std::uint8_t* miss, const RowPixels& at, std::uint64_t rows, Ints* votes);
    std::uint64_t (*keep)(const Ints* votes, unsigned rows, int min_views);
};

// All views of one brick, view by view, so that a view's constants stay in registers; rows that are out
// already are not looked at again.
KINEVOX_INLINE bool carve_brick_body(const Form& form, const HullMaps* views, int view_count,
                                     std::uint64_t inside, int min_views, float x, float y, float z,
                                     float voxel_m, std::uint64_t* occupancy) {
    const Ints lane = {0, 1, 2, 3, 4, 5, 6, 7};
    const Floats along = to_floats(lane) * voxel_m;
    Ints votes[kRows];
    const Ints known = Ints{} + __builtin_popcountll(inside) * kSeen;
    for (int row = 0; row < kRows; ++row) votes[row] = known;
    std::uint64_t alive = 0;  // a bit a row
    for (int row = 0; row < kRows; ++row) {
        alive |= static_cast<std::uint64_t>((occupancy[row >> 3] >> (8 * (row & 7)) & 255) != 0) << row;
    }
    RowPixels pixels;
    for (int n = 0; n < view_count && alive; ++n) {
        if (inside >> n & 1) continue;
        const HullMaps& view = views[n];
        const Projector c = view.camera;
        const float right = static_cast<float>(c.width) - 0.5f, bottom = static_cast<float>(c.height) - 0.5f;
        for (std::uint64_t rows = alive; rows; rows &= rows - 1) {
            const int row = __builtin_ctzll(rows);
            const CameraPoint start = to_camera(c, x, y + static_cast<float>(row & 7) * voxel_m,
                                                z + static_cast<float>(row >> 3) * voxel_m);
            const LanePixels at = project_lanes(c, start.x + along * c.r[0], start.y + along * c.r[3],
                                                start.z + along * c.r[6]);
            pixels.seen[row] = at.seen & (at.u >= -0.5f) & (at.v >= -0.5f) & (at.u < right) & (at.v < bottom);
            const Ints column = clamp_lanes(lane_index(at.u) - view.miss_x0, 0, view.miss_width - 1);
            const Ints line = clamp_lanes(lane_index(at.v) - view.miss_y0, 0, view.miss_height - 1);
            pixels.index[row] = line * view.miss_width + column;
        }
        alive = form.vote(view.miss, pixels, alive, votes);
    }
    std::uint64_t any = 0;
    for (int k = 0; k < kBrickEdge; ++k) {
        const auto rows = static_cast<unsigned>(alive >> (k * kBrickEdge) & 255);
        if (occupancy[k] != 0) occupancy[k] &= rows ? form.keep(votes + k * kBrickEdge, rows, min_views) : 0;
        any |= occupancy[k];
    }
    return any != 0;
}

bool carve_brick_plain(const HullMaps* views, int view_count, std::uint64_t inside, int min_views, float x,
                       float y, float z, float voxel_m, std::uint64_t* occupancy) {
    return carve_brick_body({vote_plain, keep_plain}, views, view_count, inside, min_views, x, y, z, voxel_m,
                            occupancy);
}

#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2 bool carve_brick_avx2(const HullMaps* views, int view_count, std::uint64_t inside, int min_views,
                                   float x, float y, float z, float voxel_m, std::uint64_t* occupancy) {
    return carve_brick_body({vote_avx2, keep_avx2}, views, view_count, inside, min_views, x, y, z, voxel_m,
                            occupancy);
}

// A view's votes on 16 voxels, two rows along x of one slice. The products are fused as the compiler fuses
// those of carve_brick_avx2(): the same bits.
class SixteenVotes {
  public:
    // The brick's first voxel is at (x, y, z).
    KINEVOX_AVX512 SixteenVotes(const HullMaps& view, float x, float y, float z, float voxel_m)
        : view_(view), z_(z), voxel_m_(voxel_m) {
        const __m512 along = _mm512_mul_ps(_mm512_setr_ps(0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7),
                                           sixteen::all(voxel_m));
        const __m512 first = _mm512_setr_ps(0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1);
        for (int axis = 0; axis < 3; ++axis) {
            const float* r = view.camera.r + static_cast<std::ptrdiff_t>(3) * axis;
            along_[axis] = _mm512_mul_ps(sixteen::all(r[0]), along);
            for (int pair = 0; pair < kPairsOfSlice; ++pair) {
                const __m512 row = _mm512_add_ps(first, sixteen::all(static_cast<float>(2 * pair)));
                const __m512 ys = _mm512_fmadd_ps(row, sixteen::all(voxel_m), sixteen::all(y));
                in_slice_[axis][pair] = _mm512_fmadd_ps(sixteen::all(r[1]), ys, sixteen::all(r[0] * x));
            }
        }
    }

    KINEVOX_AVX512 void add(int pair, __m512i& votes) const {
        const Projector& c = view_.camera;
        const __m512 z = _mm512_fmadd_ps(sixteen::all(static_cast<float>(pair / kPairsOfSlice)),
                                         sixteen::all(voxel_m_), sixteen::all(z_));
        __m512 at[3];
        for (int axis = 0; axis < 3; ++axis) {
            const __m512 start =
                _mm512_fmadd_ps(sixteen::all(c.r[3 * axis + 2]), z, in_slice_[axis][pair % kPairsOfSlice]);
            at[axis] = _mm512_add_ps(_mm512_add_ps(start, sixteen::all(c.t[axis])), along_[axis]);
        }
        const sixteen::Pixels pixels = sixteen::project(c, at[0], at[1], at[2]);
        const __mmask16 seen = in_image(pixels.v, c.height, in_image(pixels.u, c.width, pixels.seen));
        const __m512i column = place(pixels.u, view_.miss_x0, view_.miss_width),
                      line = place(pixels.v, view_.miss_y0, view_.miss_height);
        const __m512i at_pixel =
            _mm512_add_epi32(_mm512_mullo_epi32(line, sixteen::all(view_.miss_width)), column);
        // Reads kMissPadding bytes beyond each pixel.
        const __m512i miss =
            _mm512_mask_i32gather_epi32(_mm512_setzero_si512(), seen, at_pixel, view_.miss, 1);
        const __m512i here = _mm512_add_epi32(_mm512_and_si512(miss, sixteen::all(255)), sixteen::all(kSeen));
        votes = _mm512_mask_add_epi32(votes, seen, votes, here);
    }

    static constexpr int kPairsOfSlice = kBrickEdge / 2;

  private:
    KINEVOX_AVX512 static __mmask16 in_image(__m512 u, int size_px, __mmask16 asked) {
        asked = _mm512_mask_cmp_ps_mask(asked, u, sixteen::all(-0.5f), _CMP_GE_OQ);
        return _mm512_mask_cmp_ps_mask(asked, u, sixteen::all(static_cast<float>(size_px) - 0.5f),
                                       _CMP_LT_OQ);
    }
    // In the miss map, along one axis.
    KINEVOX_AVX512 static __m512i place(__m512 u, int first_px, int size_px) {
        const __m512i at = _mm512_sub_epi32(sixteen::index(u), sixteen::all(first_px));
        return _mm512_min_epi32(_mm512_max_epi32(at, _mm512_setzero_si512()), sixteen::all(size_px - 1));
    }

    const HullMaps& view_;
    const float z_, voxel_m_;
    __m512 along_[3], in_slice_[3][kPairsOfSlice];
};

// The voxels with few enough misses.
KINEVOX_AVX512 __mmask16 within_budget(__m512i votes) {
    return _mm512_cmple_epi32_mask(_mm512_and_si512(votes, sixteen::all(kSeen - 1)),
                                   sixteen::all(kMissBudget));
}

KINEVOX_AVX512 bool carve_brick_avx512(const HullMaps* views, int view_count, std::uint64_t inside,
                                       int min_views, float x, float y, float z, float voxel_m,
                                       std::uint64_t* occupancy) {
    constexpr int kPairs = kRows / 2, kOfSlice = SixteenVotes::kPairsOfSlice;
    __m512i votes[kPairs];
    std::uint32_t alive = 0;  // a bit a pair of rows
    for (int pair = 0; pair < kPairs; ++pair) {
        votes[pair] = sixteen::all(__builtin_popcountll(inside) * kSeen);
        const std::uint64_t rows = occupancy[pair / kOfSlice] >> (16 * (pair % kOfSlice));
        alive |= static_cast<std::uint32_t>((rows & 0xffff) != 0) << pair;
    }
    for (int n = 0; n < view_count && alive; ++n) {
        if (inside >> n & 1) continue;
        const SixteenVotes view(views[n], x, y, z, voxel_m);
        for (std::uint32_t pairs = alive; pairs; pairs &= pairs - 1) {
            const int pair = __builtin_ctz(pairs);
            view.add(pair, votes[pair]);
            if (within_budget(votes[pair]) == 0) alive &= ~(std::uint32_t{1} << pair);
        }
    }
    std::uint64_t any = 0;
    for (int k = 0; k < kBrickEdge; ++k) {
        std::uint64_t slice = 0;
        for (int n = 0; n < kOfSlice; ++n) {
            const __m512i& here = votes[k * kOfSlice + n];
            const __mmask16 in =
                _mm512_mask_cmpge_epi32_mask(within_budget(here), here, sixteen::all(min_views * kSeen));
            slice |= static_cast<std::uint64_t>(in) << (16 * n);
        }
        any |= occupancy[k] &= slice;
    }
    return any != 0;
}
#endif

}  // namespace

bool carve_brick(const HullMaps* views, int view_count, std::uint64_t inside, int min_views, float x, float y,
                 float z, float voxel_m, std::uint64_t* occupancy) {
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx512())
        return carve_brick_avx512(views, view_count, inside, min_views, x, y, z, voxel_m, occupancy);
    if (have_avx2())
        return carve_brick_avx2(views, view_count, inside, min_views, x, y, z, voxel_m, occupancy);
#endif
    return carve_brick_plain(views, view_count, inside, min_views, x, y, z, voxel_m, occupancy);
}

}  // namespace kinevox::kernels
