// Decides whether a camera sees a surface voxel; used by the CPU and the CUDA form.
#pragma once

#include <cfloat>
#include <cstdint>

#include "kernels/shared/camera.h"
#include "kernels/shared/device.h"
#include "kernels/types.h"

namespace kinevox::kernels {

inline constexpr float kFar_m = FLT_MAX;

struct SurfaceVoxel {
    std::int16_t x = 0, y = 0, z = 0;  // voxels from the lattice's origin
    std::uint16_t bit = 0;             // z * 64 + y * 8 + x inside the brick
    std::int32_t brick = 0;            // index into volume.bricks
    std::uint8_t open = 0;  // directions without a neighbour: bit 0 -x, 1 +x, 2 -y, 3 +y, 4 -z, 5 +z
};

// The sum of the open sides of a surface voxel, pointing outwards; `open` has a bit a direction (-x +x -y +y
// -z +z).
KINEVOX_HD inline void open_normal(unsigned open, float* normal) {
    for (int axis = 0; axis < 3; ++axis) {
        normal[axis] = static_cast<float>(static_cast<int>(open >> (2 * axis + 1) & 1) -
                                          static_cast<int>(open >> (2 * axis) & 1));
    }
}

// Where one surface voxel's centre falls in one view.
struct VoxelCell {
    std::int32_t cell = -1;  // index into the view's images of cells; -1: the camera does not see that way
    float depth_m = kFar_m;  // along the camera's axis
};

// How far behind the front a surface voxel still counts as seen, in voxels.
inline constexpr float kFacingWithin = 4;
inline constexpr float kTurnedWithin = 1.5f;

inline constexpr float kHiddenWeight = 1e-4f;  // of the colour from a view that does not see the voxel

// Cosine-like measure of how directly the camera faces a voxel's open sides; `normal` from open_normal().
KINEVOX_HD inline float facing_of(const Projector& camera, const float* normal) {
    const float* r = camera.r;  // its third row looks along the camera's axis
    return -(normal[0] * r[6] + normal[1] * r[7] + normal[2] * r[8]);
}

// Distance (m) behind the view's nearest surface within which a voxel counts as seen. Splats widen the depth
// map's edges, so that a side seen at a grazing angle lies behind its own front; sides facing the camera
// tolerate more.
KINEVOX_HD inline float seen_within(float facing, float voxel_m) {
    return (facing > 0.25f ? kFacingWithin : kTurnedWithin) * voxel_m;
}

// A view's weight in a voxel's colour, before occlusion.
KINEVOX_HD inline float colour_weight(float facing, float depth_m) {
    float weight = facing > 0.05f ? facing : 0.05f;
    weight *= weight / (depth_m * depth_m);
    return weight;
}

// Radius of the nearest voxel's splat in cells: half the projected diagonal of a voxel's face, so that the
// surface has no gaps.
KINEVOX_HD inline int splat_radius(const Projector& camera, int shift, float nearest_m, float voxel_m) {
    if (nearest_m == kFar_m) return 0;
    const float cell_px = static_cast<float>(1 << shift);
    const float focal = camera.fx > camera.fy ? camera.fx : camera.fy;
    const float cells = focal * 0.71f * voxel_m / nearest_m / cell_px + 0.5f;
    return cells < 64 ? static_cast<int>(cells) : 64;
}

// Cells of 2^shift px are about as large as a voxel that is projected to `voxel_px`: the shift is the whole
// part of the binary logarithm, found by comparisons, which round alike on every device.
KINEVOX_HD inline int cell_shift(float voxel_px) {
    const float cell_px = (voxel_px > 1 ? voxel_px : 1.f) / 0.9f;
    int shift = 0;
    while (shift < 6 && cell_px >= static_cast<float>(2 << shift)) ++shift;
    return shift;
}

// Extends the image box covered by the volume by one brick (centre, edge in m). True: its depth counts for
// the mean, too.
KINEVOX_HD inline bool frame_brick(const Projector& c, float x, float y, float z, float edge, Rect& px,
                                   float& depth_m) {
    float u, v, radius;
    depth_m = to_camera(c, x, y, z).z;
    if (!cube_bound(c, x, y, z, 0.5f * edge, u, v, radius)) {
        if (depth_m > -edge) px = {0, 0, c.width, c.height};  // possibly visible: whole image
        return false;
    }
    const Rect here{to_index(u - radius), to_index(v - radius), to_index(u + radius) + 2,
                    to_index(v + radius) + 2};
    px = {px.x0 < here.x0 ? px.x0 : here.x0, px.y0 < here.y0 ? px.y0 : here.y0,
          px.x1 > here.x1 ? px.x1 : here.x1, px.y1 > here.y1 ? px.y1 : here.y1};
    return true;
}

}  // namespace kinevox::kernels
