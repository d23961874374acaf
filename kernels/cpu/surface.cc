#include "kernels/cpu/surface.h"

#include <bit>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/simd.h"

namespace kinevox::kernels {

void BrickGrid::build(const VoxelVolume& volume) {
    nx_ = volume.lattice.size[0] / kBrickEdge + 2;
    ny_ = volume.lattice.size[1] / kBrickEdge + 2;
    const int nz = volume.lattice.size[2] / kBrickEdge + 2;
    index_.assign(static_cast<std::size_t>(nx_) * ny_ * nz, -1);
    for (std::size_t n = 0; n < volume.bricks.size(); ++n) {
        const Brick& b = volume.bricks[n];
        index_[(static_cast<std::size_t>(b.z + 1) * ny_ + (b.y + 1)) * nx_ + (b.x + 1)] = static_cast<int>(n);
    }
}

BrickNeighbours BrickGrid::neighbours(const VoxelVolume& volume, int brick) const {
    const Brick& b = volume.bricks[brick];
    BrickNeighbours out;
    out.self = b.occupancy;
    const auto at = [&](int dx, int dy, int dz) -> const std::uint64_t* {
        const int found = find(b.x + dx, b.y + dy, b.z + dz);
        return found < 0 ? nullptr : volume.bricks[found].occupancy;
    };
    out.side[0] = at(-1, 0, 0), out.side[1] = at(1, 0, 0);
    out.side[2] = at(0, -1, 0), out.side[3] = at(0, 1, 0);
    out.side[4] = at(0, 0, -1), out.side[5] = at(0, 0, 1);
    return out;
}

void Surface::build(const VoxelVolume& volume, const BrickGrid& grid) {
    constexpr int kBricksPerTask = 32;
    const int bricks = static_cast<int>(volume.bricks.size());
    first.assign(bricks + 1, 0);
    slices_.resize(static_cast<std::size_t>(bricks) * kBrickEdge);
    parallel_for(0, bricks, kBricksPerTask, [&](int begin, int end) {
        for (int n = begin; n < end; ++n) {
            const BrickNeighbours around = grid.neighbours(volume, n);
            int count = 0;
            for (int k = 0; k < kBrickEdge; ++k) {
                const std::uint64_t slice = surface_slice(around, k);
                slices_[static_cast<std::size_t>(n) * kBrickEdge + k] = slice;
                count += std::popcount(slice);
            }
            first[n + 1] = count;
        }
    });
    for (int n = 0; n < bricks; ++n) first[n + 1] += first[n];
    const int count = first[bricks], padded = count + kLanes;
    x_m.resize(padded), y_m.resize(padded), z_m.resize(padded);
    bit.resize(padded), open.resize(padded);
    const Lattice& lattice = volume.lattice;
    const float voxel = lattice.voxel_m;
    parallel_for(0, bricks, kBricksPerTask, [&](int begin, int end) {
        for (int n = begin; n < end; ++n) {
            const Brick& brick = volume.bricks[n];
            const BrickNeighbours around = grid.neighbours(volume, n);
            const auto centre = [&](int axis, int at) {
                return lattice.origin[axis] + (static_cast<float>(at * kBrickEdge) + 0.5f) * voxel;
            };
            const float x0 = centre(0, brick.x), y0 = centre(1, brick.y), z0 = centre(2, brick.z);
            int out = first[n];
            for (int k = 0; k < kBrickEdge; ++k) {
                std::uint64_t slice = slices_[static_cast<std::size_t>(n) * kBrickEdge + k];
                if (!slice) continue;
                std::uint64_t side[6];
                for (int direction = 0; direction < 6; ++direction) {
                    side[direction] = ~neighbour_slice(around, k, direction);
                }
                const float z = z0 + static_cast<float>(k) * voxel;
                for (; slice; slice &= slice - 1, ++out) {
                    const int at = std::countr_zero(slice);
                    x_m[out] = x0 + static_cast<float>(at & 7) * voxel;
                    y_m[out] = y0 + static_cast<float>(at >> 3) * voxel;
                    z_m[out] = z;
                    bit[out] = static_cast<std::uint16_t>(k * 64 + at);
                    unsigned sides = 0;
                    for (int direction = 0; direction < 6; ++direction) {
                        sides |= static_cast<unsigned>(side[direction] >> at & 1) << direction;
                    }
                    open[out] = static_cast<std::uint8_t>(sides);
                }
            }
        }
    });
}

}  // namespace kinevox::kernels
