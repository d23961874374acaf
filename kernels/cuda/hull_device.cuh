// Blocks and voxels against the silhouettes, for the carver and for the colourer's sharp silhouettes.
#pragma once

#include "kernels/shared/hull.h"

namespace kinevox::kernels::cuda {

struct HullQuestion {
    const HullMaps* maps = nullptr;  // device
    int views = 0;
    int min_views = 0;
};

// A block of `edge` bricks a side whose first brick is (bx, by, bz).
__device__ inline BlockState decide_bricks(const HullQuestion& q, const Lattice& lattice, int bx, int by,
                                           int bz, int edge) {
    const float voxel = lattice.voxel_m;
    const float half = 0.5f * static_cast<float>(edge * kBrickEdge) * voxel;
    const int brick[3] = {bx, by, bz};
    float centre[3];
    for (int axis = 0; axis < 3; ++axis) {
        centre[axis] = lattice.origin[axis] + static_cast<float>(brick[axis] * kBrickEdge) * voxel + half;
    }
    return decide_block(q.maps, q.views, q.min_views, centre[0], centre[1], centre[2], half - 0.5f * voxel);
}

// Voxel `bit` (z * 64 + y * 8 + x) of brick (bx, by, bz).
__device__ inline bool voxel_inside(const HullQuestion& q, const Lattice& lattice, int bx, int by, int bz,
                                    int bit) {
    const float voxel = lattice.voxel_m;
    const auto centre = [&](int axis, int brick) {
        return lattice.origin[axis] + (static_cast<float>(brick * kBrickEdge) + 0.5f) * voxel;
    };
    const float x = centre(0, bx), along = static_cast<float>(bit & 7);
    const float y = centre(1, by) + static_cast<float>(bit >> 3 & 7) * voxel;
    const float z = centre(2, bz) + static_cast<float>(bit >> 6) * voxel;
    int misses = 0, contain = 0;
    for (int n = 0; n < q.views; ++n) {
        const HullMaps& view = q.maps[n];
        const Projector& c = view.camera;
        CameraPoint p = to_camera(c, x, y, z);
        p.x += along * (c.r[0] * voxel), p.y += along * (c.r[3] * voxel), p.z += along * (c.r[6] * voxel);
        float u, v;
        if (!to_pixel(c, p, u, v)) continue;
        const int miss = miss_at(view, u, v);
        if (miss < 0) continue;
        misses += miss;
        if (misses > kMissBudget) return false;
        ++contain;
    }
    return contain >= q.min_views;
}

}  // namespace kinevox::kernels::cuda
