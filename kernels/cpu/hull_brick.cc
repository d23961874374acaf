#include "kernels/cpu/hull.h"
#include "kernels/cpu/project_lanes.h"
#include "kernels/types.h"

#ifdef KINEVOX_HAVE_AVX2_FORM
#include <immintrin.h>
#endif

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
#endif

}  // namespace

bool carve_brick(const HullMaps* views, int view_count, std::uint64_t inside, int min_views, float x, float y,
                 float z, float voxel_m, std::uint64_t* occupancy) {
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2())
        return carve_brick_avx2(views, view_count, inside, min_views, x, y, z, voxel_m, occupancy);
#endif
    return carve_brick_plain(views, view_count, inside, min_views, x, y, z, voxel_m, occupancy);
}

}  // namespace kinevox::kernels
