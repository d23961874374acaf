// Fills holes, as kernels/cpu/surrounded.cc.
#include "kernels/cuda/bricks.cuh"
#include "kernels/cuda/volume.h"
#include "kernels/shared/surrounded.h"

namespace kinevox::kernels::cuda {
namespace {

// Where the voxels of a row have one within `steps` steps of `step` on both sides; in the bits of the row.
__device__ std::uint32_t between(const BrickRows& rows, int z, int y, const int* step, int steps) {
    std::uint32_t before = 0, after = 0;
    for (int s = 1; s <= steps; ++s) {
        const int shift = s * step[0];
        after |= rows[z + s * step[2]][y + s * step[1]] >> shift;
        before |= rows[z - s * step[2]][y - s * step[1]] << shift;
    }
    return before & after;
}

// The empty voxels of a row of the brick that lie between others along at least `min_lines` lines.
__device__ std::uint32_t surrounded(const BrickRows& rows, int z, int y, int radius, int min_lines) {
    const std::uint32_t empty = ~rows[z][y] & 0xff00u;
    if (empty == 0) return 0;
    std::uint32_t ones = 0, twos = 0, fours = 0;  // how many lines, a word a binary digit
    for (int n = 0; n < kFillLines; ++n) {
        int step[3];
        fill_line(n, step);
        const std::uint32_t line = between(rows, z, y, step, fill_steps(n, radius)), carry = ones & line;
        ones ^= line;
        fours |= twos & carry;
        twos ^= carry;
    }
    std::uint32_t enough = 0;
    for (int count = min_lines; count <= kFillLines; ++count)
        enough |= (count & 1 ? ones : ~ones) & (count & 2 ? twos : ~twos) & (count & 4 ? fours : ~fours);
    return (enough & empty) >> kBrickEdge;
}

// One block a brick, a thread a row of it. Bricks without a voxel are left so.
__global__ void __launch_bounds__(kBrickThreads)
    fill_bricks(const VolumeJob* __restrict__ job, int now, int radius, int min_lines, bool counts) {
    __shared__ std::uint64_t around[27][kBrickEdge];
    __shared__ BrickRows rows;
    __shared__ int filled;
    const int thread = static_cast<int>(threadIdx.x), bricks = job->state->bricks;
    const int y = thread % kBrickEdge, k = thread / kBrickEdge;
    for (int n = static_cast<int>(blockIdx.x); n < bricks; n += static_cast<int>(gridDim.x)) {
        __syncthreads();  // all have read what the brick before left
        if (thread == 0) filled = 0;
        load_around(*job, job->occupancy[now], n, true, around);
        __syncthreads();
        make_rows(around, rows);
        const bool any = __syncthreads_or(thread < kBrickEdge && around[kCentre][thread % kBrickEdge] != 0);
        if (k < kBrickEdge) {
            std::uint32_t row = rows[kBrickEdge + k][kBrickEdge + y] >> kBrickEdge & 255;
            if (any) {
                const std::uint32_t more =
                    surrounded(rows, kBrickEdge + k, kBrickEdge + y, radius, min_lines);
                if (counts && more != 0) atomicAdd(&filled, __popc(more));
                row |= more;
            }
            reinterpret_cast<std::uint8_t*>(job->occupancy[1 - now] +
                                            static_cast<std::size_t>(n) * kBrickEdge)[thread] =
                static_cast<std::uint8_t>(row);
        }
        __syncthreads();
        if (thread == 0 && filled > 0)
            atomicAdd(&job->state->filled, static_cast<unsigned long long>(filled));
    }
}

}  // namespace

void queue_filling(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int now,
                   int radius, int min_lines, bool counts) {
    fill_bricks<<<blocks.bricks, kBrickThreads, 0, stream.get()>>>(job, now, radius, min_lines, counts);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
