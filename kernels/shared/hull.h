// Decides blocks and voxels of the visual hull; used by the CPU and the CUDA form.
#pragma once

#include <cstdint>

#include "kernels/shared/camera.h"
#include "kernels/shared/device.h"

namespace kinevox::kernels {

inline constexpr int kMaxViews = 64;
inline constexpr int kMissBudget = 252;   // voxels whose misses, summed over the views, exceed it are outside
inline constexpr int kMissOutside = 255;  // one view alone rejects
inline constexpr int kMissPadding = 3;    // bytes, for the CPU's gathers of 32 bits

// One view's maps; the pointers are the device's own. Distances are chessboard distances in px between
// pixels.
struct HullMaps {
    Projector camera;

    // Per cell of 2^cell_shift px, over the silhouette's bounds: +n: n cells to the nearest cell with
    // foreground; -n: n cells to the nearest cell that is not wholly foreground; 0: mixed. Clamped to +-127.
    const std::int8_t* cells = nullptr;
    int cell_shift = 0;
    int cells_x0 = 0, cells_y0 = 0, cells_width = 0, cells_height = 0;  // in cells

    // Per pixel, in an area that has a rim of kMissOutside around the silhouette: 0 in the silhouette, else
    // the distance to it in fractions of the budget. kMissPadding bytes more can be read behind it.
    const std::uint8_t* miss = nullptr;
    int miss_x0 = 0, miss_y0 = 0, miss_width = 0, miss_height = 0;  // px

    int budget_px = 0;

    KINEVOX_HD int miss_of_distance(int distance_px) const {
        if (distance_px <= 0) return 0;
        return distance_px > budget_px ? kMissOutside : distance_px * kMissBudget / budget_px;
    }
};

enum class BlockState : std::uint8_t { kEmpty = 0, kFull = 1, kMixed = 2 };

// All voxel centres of the block lie within +-half_edge (m) of (x, y, z) along each axis. `inside`, if asked
// for, gets a bit for each view that sees and contains the whole block; not for blocks that are empty.
KINEVOX_HD inline BlockState decide_block(const HullMaps* views, int view_count, int min_views, float x,
                                          float y, float z, float half_edge,
                                          std::uint64_t* inside = nullptr) {
    int misses = 0, may_contain = 0, contain = 0;
    std::uint64_t containing = 0;
    bool certain = true;
    for (int n = 0; n < view_count; ++n) {
        const HullMaps& view = views[n];
        float u, v, radius;
        if (!cube_bound(view.camera, x, y, z, half_edge, u, v, radius)) {
            certain = false;
            ++may_contain;
            continue;
        }
        const float right = view.camera.width - 0.5f, bottom = view.camera.height - 0.5f;
        if (u + radius < -0.5f || v + radius < -0.5f || u - radius >= right || v - radius >= bottom) continue;
        if (u - radius < -0.5f || v - radius < -0.5f || u + radius >= right || v + radius >= bottom) {
            certain = false;
            ++may_contain;
            continue;
        }
        const int max_offset_px =
            static_cast<int>(radius) + 1;  // maximum offset of a voxel's pixel from this one
        int column = (to_index(u) >> view.cell_shift) - view.cells_x0;
        int row = (to_index(v) >> view.cell_shift) - view.cells_y0;
        int beyond =
            0;  // cells from the bounds; moving into them never lengthens a distance to a point in them
        if (column < 0) beyond = -column, column = 0;
        if (column >= view.cells_width) beyond = column - view.cells_width + 1, column = view.cells_width - 1;
        int beyond_y = 0;
        if (row < 0) beyond_y = -row, row = 0;
        if (row >= view.cells_height) beyond_y = row - view.cells_height + 1, row = view.cells_height - 1;
        if (beyond_y > beyond) beyond = beyond_y;
        int cells = view.cells ? view.cells[row * view.cells_width + column] : 127;
        if (beyond > 0) cells = cells > beyond ? cells : beyond;
        if (cells > 0) {
            certain = false;
            const int distance = ((cells - 1) << view.cell_shift) + 1 - max_offset_px;
            const int miss = view.miss_of_distance(distance);
            misses += miss;
            if (misses > kMissBudget) return BlockState::kEmpty;
            ++may_contain;
        } else if (cells < 0 && max_offset_px <= ((-cells - 1) << view.cell_shift)) {
            ++contain;
            ++may_contain;
            containing |= std::uint64_t{1} << n;
        } else {
            certain = false;
            ++may_contain;
        }
    }
    if (may_contain < min_views) return BlockState::kEmpty;
    if (inside) *inside = containing;
    return certain && contain >= min_views ? BlockState::kFull : BlockState::kMixed;
}

// The miss of the pixel at (u, v), or -1 outside the image.
KINEVOX_HD KINEVOX_INLINE int miss_at(const HullMaps& view, float u, float v) {
    if (!(u >= -0.5f && v >= -0.5f && u < view.camera.width - 0.5f && v < view.camera.height - 0.5f))
        return -1;
    int column = to_index(u) - view.miss_x0, row = to_index(v) - view.miss_y0;
    column = column < 0 ? 0 : (column >= view.miss_width ? view.miss_width - 1 : column);
    row = row < 0 ? 0 : (row >= view.miss_height ? view.miss_height - 1 : row);
    return view.miss[row * view.miss_width + column];
}

}  // namespace kinevox::kernels
