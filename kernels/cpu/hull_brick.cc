#include "kernels/cpu/hull_brick.h"

#include "kernels/cpu/project_lanes.h"
#include "kernels/types.h"

namespace kinevox::kernels {
namespace {

// A voxel's votes in one number: misses in the low 16 bits, the views that see it above.
constexpr int kSeen = 1 << 16;
static_assert(kMaxViews * kMissOutside < kSeen);

// All views of one brick, view by view, so that a view's constants stay in registers; rows that are out already are
// not looked at again.
KINEVOX_INLINE bool carve_brick_body(const HullMaps* views, int view_count, int min_views, float x, float y, float z,
                                     float voxel_m, std::uint64_t* occupancy) {
    constexpr int kRows = kBrickEdge * kBrickEdge;
    const Ints lane = {0, 1, 2, 3, 4, 5, 6, 7};
    const Floats along = to_floats(lane) * voxel_m;
    Ints votes[kRows];
    for (int row = 0; row < kRows; ++row) votes[row] = Ints{};
    std::uint64_t alive = 0;  // a bit a row
    for (int row = 0; row < kRows; ++row) {
        alive |= static_cast<std::uint64_t>((occupancy[row >> 3] >> (8 * (row & 7)) & 255) != 0) << row;
    }
    for (int n = 0; n < view_count && alive; ++n) {
        const HullMaps& view = views[n];
        const Projector& c = view.camera;
        const float right = static_cast<float>(c.width) - 0.5f, bottom = static_cast<float>(c.height) - 0.5f;
        for (std::uint64_t rows = alive; rows; rows &= rows - 1) {
            const int row = __builtin_ctzll(rows);
            const CameraPoint start = to_camera(c, x, y + static_cast<float>(row & 7) * voxel_m,
                                                z + static_cast<float>(row >> 3) * voxel_m);
            const LanePixels at = project_lanes(c, start.x + along * c.r[0], start.y + along * c.r[3],
                                                start.z + along * c.r[6]);
            const Ints seen = at.seen & (at.u >= -0.5f) & (at.v >= -0.5f) & (at.u < right) & (at.v < bottom);
            const Ints column = clamp_lanes(lane_index(at.u) - view.miss_x0, 0, view.miss_width - 1);
            const Ints line = clamp_lanes(lane_index(at.v) - view.miss_y0, 0, view.miss_height - 1);
            const Ints index = line * view.miss_width + column;
            Ints miss;
            for (int i = 0; i < kLanes; ++i) miss[i] = view.miss[index[i]];
            votes[row] += seen & (miss + kSeen);
            const Ints out = (votes[row] & (kSeen - 1)) > kMissBudget;
            std::int64_t words[4];
            std::memcpy(words, &out, sizeof(words));
            if ((words[0] & words[1] & words[2] & words[3]) == -1) alive &= ~(std::uint64_t{1} << row);
        }
    }
    std::uint64_t any = 0;
    for (int k = 0; k < kBrickEdge; ++k) {
        std::uint64_t slice = 0;
        for (int j = 0; j < kBrickEdge; ++j) {
            const int row = k * kBrickEdge + j;
            if (!(alive >> row & 1)) continue;
            const Ints in = ((votes[row] & (kSeen - 1)) <= kMissBudget) & (votes[row] >= min_views * kSeen);
            std::uint64_t bits = 0;
            for (int i = 0; i < kLanes; ++i) bits |= static_cast<std::uint64_t>(in[i] & 1) << i;
            slice |= bits << (j * kBrickEdge);
        }
        occupancy[k] &= slice;
        any |= occupancy[k];
    }
    return any != 0;
}

bool carve_brick_plain(const HullMaps* views, int view_count, int min_views, float x, float y, float z,
                       float voxel_m, std::uint64_t* occupancy) {
    return carve_brick_body(views, view_count, min_views, x, y, z, voxel_m, occupancy);
}

#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2 bool carve_brick_avx2(const HullMaps* views, int view_count, int min_views, float x, float y, float z,
                                   float voxel_m, std::uint64_t* occupancy) {
    return carve_brick_body(views, view_count, min_views, x, y, z, voxel_m, occupancy);
}
#endif

}  // namespace

bool carve_brick(const HullMaps* views, int view_count, int min_views, float x, float y, float z, float voxel_m,
                 std::uint64_t* occupancy) {
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) return carve_brick_avx2(views, view_count, min_views, x, y, z, voxel_m, occupancy);
#endif
    return carve_brick_plain(views, view_count, min_views, x, y, z, voxel_m, occupancy);
}

}  // namespace kinevox::kernels
