// What a block of threads does for one brick of a volume.
#pragma once

#include "kernels/cuda/volume.h"

namespace kinevox::kernels::cuda {

inline constexpr int kBrickThreads = 128;
inline constexpr int kRows = 3 * kBrickEdge;
inline constexpr int kCentre = 13;  // of 27 bricks, x fastest

// In shared memory.
struct BrickSurface {
    std::uint64_t around[27][kBrickEdge];  // occupancy of the brick and of the 26 around it; 0 where none is
    std::uint64_t slices[kBrickEdge];      // its surface
    std::uint16_t voxels[kBrickVoxels];    // its voxels, as bits of the occupancy, in order
    int count;
};

// Row (z, y) of the 27 bricks along x, a bit a voxel; the brick's own voxels from 8 to 15 each way.
using BrickRows = std::uint32_t[kRows][kRows];

// The index of one of 27 bricks, -1 where there is none.
__device__ inline int brick_around(const VolumeJob& job, const BrickPosition& centre, int n) {
    return job.index[job.at(centre.x + n % 3 - 1, centre.y + n / 3 % 3 - 1, centre.z + n / 9 - 1)];
}

// Only the six that share a side, unless `corners` are asked for, too.
__device__ inline void load_around(const VolumeJob& job, const std::uint64_t* occupancy, int brick,
                                   bool corners, std::uint64_t (*around)[kBrickEdge]) {
    const BrickPosition centre = job.positions[brick];
    for (int i = static_cast<int>(threadIdx.x); i < 27 * kBrickEdge; i += static_cast<int>(blockDim.x)) {
        const int n = i / kBrickEdge, k = i % kBrickEdge;
        const int sides = (n % 3 != 1) + (n / 3 % 3 != 1) + (n / 9 != 1);
        if (!corners && sides > 1) continue;
        const int found = n == kCentre ? brick : brick_around(job, centre, n);
        around[n][k] = found < 0 ? 0 : occupancy[static_cast<std::size_t>(found) * kBrickEdge + k];
    }
}

__device__ inline void make_rows(const std::uint64_t (*around)[kBrickEdge], BrickRows& rows) {
    for (int i = static_cast<int>(threadIdx.x); i < kRows * kRows; i += static_cast<int>(blockDim.x)) {
        const int z = i / kRows, y = i % kRows, first = (z / kBrickEdge * 3 + y / kBrickEdge) * 3;
        std::uint32_t row = 0;
        for (int n = 0; n < 3; ++n) {
            const std::uint64_t slice = around[first + n][z % kBrickEdge];
            row |= static_cast<std::uint32_t>(slice >> y % kBrickEdge * kBrickEdge & 255) << n * kBrickEdge;
        }
        rows[z][y] = row;
    }
}

__device__ inline BrickNeighbours neighbours_in(const BrickSurface& surface) {
    const int side[6] = {kCentre - 1, kCentre + 1, kCentre - 3, kCentre + 3, kCentre - 9, kCentre + 9};
    BrickNeighbours out;
    out.self = surface.around[kCentre];
    for (int n = 0; n < 6; ++n) out.side[n] = surface.around[side[n]];
    return out;
}

// By the whole block, which may still read what `surface` held before.
__device__ inline void find_surface(const VolumeJob& job, const std::uint64_t* occupancy, int brick,
                                    bool corners, BrickSurface& surface) {
    const int thread = static_cast<int>(threadIdx.x);
    __syncthreads();
    load_around(job, occupancy, brick, corners, surface.around);
    __syncthreads();
    if (thread < kBrickEdge) surface.slices[thread] = surface_slice(neighbours_in(surface), thread);
    __syncthreads();
    for (int bit = thread; bit < kBrickVoxels; bit += static_cast<int>(blockDim.x)) {
        const std::uint64_t slice = surface.slices[bit / 64];
        if (!(slice >> bit % 64 & 1)) continue;
        int before = __popcll(slice & ((std::uint64_t{1} << bit % 64) - 1));
        for (int k = 0; k < bit / 64; ++k) before += __popcll(surface.slices[k]);
        surface.voxels[before] = static_cast<std::uint16_t>(bit);
    }
    if (thread == 0) {
        surface.count = 0;
        for (int k = 0; k < kBrickEdge; ++k) surface.count += __popcll(surface.slices[k]);
    }
    __syncthreads();
}

// The sides of a voxel that have no neighbour, as SurfaceVoxel::open.
__device__ inline unsigned open_sides(const BrickSurface& surface, int bit) {
    const BrickNeighbours neighbours = neighbours_in(surface);
    unsigned open = 0;
    for (int side = 0; side < 6; ++side)
        open |= static_cast<unsigned>(~neighbour_slice(neighbours, bit / 64, side) >> bit % 64 & 1) << side;
    return open;
}

// Where a voxel of a brick falls in a view.
__device__ inline VoxelCell cell_of(const Lattice& lattice, const BrickPosition& brick, int bit,
                                    const Projector& camera, const ViewState& view) {
    const float voxel = lattice.voxel_m;
    const auto centre = [&](int axis, int place) {
        return lattice.origin[axis] + 0.5f * voxel + voxel * static_cast<float>(place);
    };
    const CameraPoint p = to_camera(camera, centre(0, brick.x * kBrickEdge + (bit & 7)),
                                    centre(1, brick.y * kBrickEdge + (bit >> 3 & 7)),
                                    centre(2, brick.z * kBrickEdge + (bit >> 6)));
    VoxelCell out;
    out.depth_m = p.z;
    float u, v;
    if (!to_pixel(camera, p, u, v)) return out;
    const int column = (to_index(u) >> view.shift) - view.cells.x0;
    const int row = (to_index(v) >> view.shift) - view.cells.y0;
    if (column >= 0 && row >= 0 && column < view.width && row < view.height)
        out.cell = row * view.width + column;
    return out;
}

// Calls put(n, sum of get(m) for m < n) for n < count and returns the sum of all, to every thread; by one
// block of kScanThreads. `warp_sums`: 32 shared integers.
inline constexpr int kScanThreads = 1024;
template <class Get, class Put>
__device__ int scan_by_block(int count, int* warp_sums, const Get& get, const Put& put) {
    constexpr int kItems = 8;
    int total = 0;
    for (int first = 0; first < count; first += kScanThreads * kItems) {
        const int begin = first + static_cast<int>(threadIdx.x) * kItems;
        int values[kItems], own = 0;
        for (int i = 0; i < kItems; ++i) {
            values[i] = begin + i < count ? get(begin + i) : 0;
            own += values[i];
        }
        int before = total + inclusive_sum_of_block(own, warp_sums) - own;
        for (int i = 0; i < kItems; ++i) {
            if (begin + i < count) put(begin + i, before);
            before += values[i];
        }
        total += warp_sums[31];
        __syncthreads();
    }
    return total;
}

}  // namespace kinevox::kernels::cuda
