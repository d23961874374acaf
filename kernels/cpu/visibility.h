// Visibility of surface voxels: each view has a depth map of the volume itself, on a grid of cells about as
// large as a projected voxel, so that the cost depends on the surface and not on the camera's resolution.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernels/cpu/surface.h"
#include "kernels/shared/camera.h"
#include "kernels/shared/visibility.h"
#include "kernels/types.h"

namespace kinevox::kernels {

// Nearest and farthest surface in a cell; kFar_m and 0 where there is none. The farthest is kept with its
// sign turned, so that both are minima.
struct DepthCell {
    float front_m = kFar_m, minus_back_m = 0;

    bool empty() const { return front_m == kFar_m; }
    float between_m() const { return -minus_back_m - front_m; }
};

KINEVOX_INLINE DepthCell nearer(DepthCell a, DepthCell b) {
    return {a.front_m < b.front_m ? a.front_m : b.front_m,
            a.minus_back_m < b.minus_back_m ? a.minus_back_m : b.minus_back_m};
}

struct RowSpan {
    int first = 0, last = 0;  // columns, [first, last)
};

struct ViewOfVolume {
    Projector camera;
    int shift = 0;                   // a cell is 2^shift px wide and high
    int radius = 0;                  // cells by which a projected voxel extends beyond the cell of its centre
    Rect cells;                      // the part of the image that is looked at, in cells
    std::vector<std::int32_t> cell;  // per surface voxel: index into the images of cells; -1: not seen there
    std::vector<float> depth_m;      // per surface voxel: along the camera's axis
    std::vector<DepthCell> depths;   // per cell
    std::vector<RowSpan> spans;      // per row of cells: outside of it nothing of the volume is ever seen
    std::vector<DepthCell> scratch;  // rows of cells
    // For each of the 64 combinations of open sides (Surface::open): facing_of(), and how far behind the
    // front a voxel still counts as seen, m.
    std::array<float, 64> facing, behind_m;

    std::size_t cell_count() const { return static_cast<std::size_t>(cells.width()) * cells.height(); }
};

// True if the view sees surface voxel n, whose open sides are `open`.
inline bool sees(const ViewOfVolume& view, int n, unsigned open) {
    const int cell = view.cell[n];
    return cell >= 0 && view.depth_m[n] <= view.depths[cell].front_m + view.behind_m[open];
}

// Sets `shift` and `cells` for a volume (where its bricks can fall, clipped to the image), `facing` and
// `behind_m`.
void frame_view(const VoxelVolume& volume, ViewOfVolume& view);

// From what the bricks gave (frame_brick(): the box in px, the sum of the depths and their number).
void finish_frame(float voxel_m, Rect px, double depth_sum_m, int seen, ViewOfVolume& view);

// Projects the surface: fills `cell`, `depth_m` and `depths`, the latter without holes where the surface has
// none, and sets `radius`. With `first_look` also finds `spans`, which remain valid while the volume is
// carved.
void look_at_surface(const Surface& surface, float voxel_m, bool first_look, ViewOfVolume& view);

}  // namespace kinevox::kernels
