// Detects holes in the volume; used by the CPU and the CUDA form.
//
// A hole in one silhouette drills a tunnel through the volume along that camera's rays. A voxel in it has the
// volume on both sides of it along almost every line, but for the tunnel's own direction; between two legs or
// under an arm there are only few such lines.
#pragma once

#include "kernels/shared/device.h"
#include "kernels/types.h"

namespace kinevox::kernels {

inline constexpr int kFillLines = 7;               // the three axes and the four diagonals of a cube
inline constexpr int kFillLinesOfHull = 6;         // that must meet the volume on both sides
inline constexpr int kFillLinesOfColouring = 5;    // the same within the hull, after the sharp silhouettes
inline constexpr int kFillPassesOfColouring = 2;   // the second closes what the first made narrower
inline constexpr int kMaxFillRadius = kBrickEdge;  // voxels: only neighbouring bricks are read

// A step along line n, each -1, 0 or 1.
KINEVOX_HD inline void fill_line(int n, int* step) {
    for (int axis = 0; axis < 3; ++axis) step[axis] = n == axis;
    if (n < 3) return;
    step[0] = 1;
    step[1] = (n - 3) & 1 ? -1 : 1;
    step[2] = (n - 3) & 2 ? -1 : 1;
}

// Number of steps along line n that cover about `radius` voxels.
KINEVOX_HD inline int fill_steps(int n, int radius) {
    const int diagonal = (radius * 37 + 32) / 64;  // over the root of 3, rounded
    return n < 3 || radius < 1 ? radius : (diagonal < 1 ? 1 : diagonal);
}

// Converts a length to a radius in voxels.
KINEVOX_HD inline int fill_radius_voxels(float length_m, float voxel_m) {
    const float voxels = length_m / voxel_m + 0.5f;
    return voxels < kMaxFillRadius ? static_cast<int>(voxels) : kMaxFillRadius;
}

}  // namespace kinevox::kernels
