#include "kernels/projection.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

#include "kernels/cpu/run_components.h"
#include "kernels/cpu/surface.h"
#include "kernels/shared/camera.h"

namespace kinevox::kernels {
namespace {

// Dilates the mask by `radius` px along both axes and updates `bounds`.
void dilate(std::uint8_t* mask, int width, int height, int radius, Rect& bounds) {
    bounds = {std::max(bounds.x0 - radius, 0), std::max(bounds.y0 - radius, 0),
              std::min(bounds.x1 + radius, width), std::min(bounds.y1 + radius, height)};
    const int columns = bounds.width(), rows = bounds.height();
    // Along the rows by runs. Then across them by doubling: a line that holds the OR of `span` lines from
    // itself on becomes that of twice as many, and two of those that overlap make the whole window.
    std::vector<std::uint8_t> along(static_cast<std::size_t>(columns) * (rows + 2 * radius), 0);
    const auto line = [&](int y) { return along.data() + static_cast<std::ptrdiff_t>(y + radius) * columns; };
    for (int y = 0; y < rows; ++y) {
        const std::uint8_t* in = mask + static_cast<std::size_t>(y + bounds.y0) * width + bounds.x0;
        cpu::for_each_run(in, 0, columns, [&](int first, int last) {
            const int left = std::max(first - radius, 0), right = std::min(last + radius, columns);
            std::memset(line(y) + left, 255, static_cast<std::size_t>(right - left));
        });
    }
    const int window = 2 * radius + 1, last_line = rows + radius;
    int span = 1;
    for (; 2 * span <= window; span *= 2)
        for (int y = -radius; y + span < last_line; ++y) {
            std::uint8_t* out = line(y);
            const std::uint8_t* in = line(y + span);
#pragma GCC ivdep
            for (int x = 0; x < columns; ++x) out[x] |= in[x];
        }
    for (int y = 0; y < rows; ++y) {
        std::uint8_t* out = mask + static_cast<std::size_t>(y + bounds.y0) * width + bounds.x0;
        const std::uint8_t *first = line(y - radius), *second = line(y + radius + 1 - span);
#pragma GCC ivdep
        for (int x = 0; x < columns; ++x) out[x] = first[x] | second[x];
    }
}

}  // namespace

void project_volume(const VoxelVolume& volume, const CameraModel& camera, const float translation_m[3],
                    int dilate_px, std::uint8_t* mask, Rect& bounds) {
    const Projector c = make_projector(camera, "projection: camera");
    std::memset(mask, 0, static_cast<std::size_t>(c.width) * c.height);
    bounds = {c.width, c.height, 0, 0};
    const Lattice& lattice = volume.lattice;
    const float voxel = lattice.voxel_m;
    float origin[3];
    for (int axis = 0; axis < 3; ++axis) origin[axis] = lattice.origin[axis] + translation_m[axis];
    BrickGrid grid;
    grid.build(volume);
    for (int n = 0; n < static_cast<int>(volume.bricks.size()); ++n) {
        const Brick& brick = volume.bricks[n];
        const BrickNeighbours around = grid.neighbours(volume, n);
        const int at[3] = {brick.x, brick.y, brick.z};
        float corner[3];
        for (int axis = 0; axis < 3; ++axis) {
            corner[axis] = origin[axis] + static_cast<float>(at[axis] * kBrickEdge) * voxel;
        }
        // Projected radius of a cube of 2^3 voxels, once per brick. The cubes of a surface overlap in the
        // image, so that three quarters of the bound leave no holes.
        float u, v, radius;
        const float half = 0.5f * kBrickEdge * voxel;
        if (!cube_bound(c, corner[0] + half, corner[1] + half, corner[2] + half, voxel, u, v, radius))
            continue;
        radius *= 0.75f;
        for (int k = 0; k < kBrickEdge; k += 2) {
            // Of each cube with surface in it, the bit of its lowest corner.
            std::uint64_t cubes = surface_slice(around, k) | surface_slice(around, k + 1);
            cubes |= cubes >> 1;
            cubes |= cubes >> 8;
            for (cubes &= 0x0055005500550055u; cubes; cubes &= cubes - 1) {
                const int bit = std::countr_zero(cubes);
                const CameraPoint point = to_camera(c, corner[0] + static_cast<float>((bit & 7) + 1) * voxel,
                                                    corner[1] + static_cast<float>((bit >> 3) + 1) * voxel,
                                                    corner[2] + static_cast<float>(k + 1) * voxel);
                if (!to_pixel(c, point, u, v)) continue;
                const int left = std::max(to_index(u - radius), 0);
                const int right = std::min(to_index(u + radius) + 1, c.width);
                const int top = std::max(to_index(v - radius), 0);
                const int bottom = std::min(to_index(v + radius) + 1, c.height);
                if (left >= right || top >= bottom) continue;
                for (int y = top; y < bottom; ++y) {
                    std::uint8_t* row = mask + static_cast<std::size_t>(y) * c.width;
                    std::fill(row + left, row + right, std::uint8_t{255});
                }
                bounds = {std::min(bounds.x0, left), std::min(bounds.y0, top), std::max(bounds.x1, right),
                          std::max(bounds.y1, bottom)};
            }
        }
    }
    if (bounds.empty()) {
        bounds = {};
    } else if (dilate_px > 0) {
        dilate(mask, c.width, c.height, dilate_px, bounds);
    }
}

}  // namespace kinevox::kernels
