// Which camera sees which surface voxel: each view's depth picture of the volume itself, on a grid of cells that
// are about as large as a voxel's picture, so that the cost follows the surface and not the camera's resolution.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/cpu/surface.h"
#include "kernels/shared/camera.h"
#include "kernels/shared/visibility.h"
#include "kernels/types.h"

namespace kinevox::kernels {

struct ViewOfVolume {
    Projector camera;
    int shift = 0;                       // a cell is 2^shift px wide and high
    int reach = 0;                       // cells by which a voxel's picture is wider than its centre's cell
    Rect cells;                          // the part of the picture that is looked at, in cells
    std::vector<std::int32_t> cell;      // per surface voxel: index into the pictures of cells; -1: not seen there
    std::vector<float> depth_m;          // per surface voxel: along the camera's axis
    std::vector<float> front_m, back_m;  // per cell: nearest and farthest surface; kFar_m and 0 where there is none
    std::vector<float> scratch;

    std::size_t cell_count() const { return static_cast<std::size_t>(cells.width()) * cells.height(); }
};

// True if the view sees surface voxel n. `normal` points out of the volume (the sum of the voxel's open sides).
inline bool sees(const ViewOfVolume& view, int n, const float* normal, float voxel_m) {
    const int cell = view.cell[n];
    return cell >= 0 && in_front(view.depth_m[n], view.front_m[cell], facing_of(view.camera, normal), voxel_m);
}

// Sets `shift` and `cells` for a volume: where its bricks can fall, clipped to the picture.
void frame_view(const VoxelVolume& volume, ViewOfVolume& view);

// From what the bricks gave (frame_brick(): the box in px, the sum of the depths and their number).
void finish_frame(float voxel_m, Rect px, double depth_sum_m, int seen, ViewOfVolume& view);

// Makes room in view.cell and view.depth_m; then fills them for the surface's voxels [first, last), `first` a
// multiple of 8.
void make_room(const Surface& surface, ViewOfVolume& view);
void project_surface(const Surface& surface, int first, int last, ViewOfVolume& view);

// Fills front_m and back_m, without holes where the surface has none, and sets `reach`.
void splat_depth(const Surface& surface, float voxel_m, ViewOfVolume& view);

}  // namespace kinevox::kernels
