#include "kernels/cuda/surrounded.h"
#include "kernels/shared/surrounded.h"

namespace kinevox::kernels::cuda {
namespace {

constexpr int kWords = kBrickVoxels / 32;  // of a brick's occupancy

// `around`: the brick and the 26 around it, x fastest; (x, y, z) from the brick's first voxel, each -8 .. 15.
__device__ bool occupied(const std::uint64_t (*around)[kBrickEdge], int x, int y, int z) {
    x += kBrickEdge, y += kBrickEdge, z += kBrickEdge;
    const int brick = (z / kBrickEdge * 3 + y / kBrickEdge) * 3 + x / kBrickEdge;
    return around[brick][z % kBrickEdge] >> (y % kBrickEdge * kBrickEdge + x % kBrickEdge) & 1;
}

__device__ bool surrounded(const std::uint64_t (*around)[kBrickEdge], int bit, int radius, int min_lines) {
    const int x = bit & 7, y = bit >> 3 & 7, z = bit >> 6;
    int lines = 0;
    for (int n = 0; n < kFillLines; ++n) {
        int step[3];
        fill_line(n, step);
        const int steps = fill_steps(n, radius);
        bool before = false, after = false;
        for (int s = 1; s <= steps; ++s) {
            before = before || occupied(around, x - s * step[0], y - s * step[1], z - s * step[2]);
            after = after || occupied(around, x + s * step[0], y + s * step[1], z + s * step[2]);
        }
        lines += before && after;
    }
    return lines >= min_lines;
}

// One block a brick, one thread a voxel; fill: 16 words a brick. Bricks without a voxel are left so.
__global__ void find_surrounded(const Brick* bricks, BrickTable table, int radius, int min_lines,
                                std::uint32_t* fill) {
    __shared__ std::uint64_t around[27][kBrickEdge];
    const Brick& centre = bricks[blockIdx.x];
    const int bit = threadIdx.x;
    if (bit < 27 * kBrickEdge) {
        const int n = bit / kBrickEdge;
        const int found =
            table.index[table.at(centre.x + n % 3 - 1, centre.y + n / 3 % 3 - 1, centre.z + n / 9 - 1)];
        around[n][bit % kBrickEdge] = found < 0 ? 0 : bricks[found].occupancy[bit % kBrickEdge];
    }
    __syncthreads();
    std::uint64_t any = 0;
    for (int k = 0; k < kBrickEdge; ++k) any |= centre.occupancy[k];
    const bool empty = !occupied(around, bit & 7, bit >> 3 & 7, bit >> 6);
    const unsigned word =
        __ballot_sync(0xffffffffu, any != 0 && empty && surrounded(around, bit, radius, min_lines));
    if (bit % 32 == 0) fill[blockIdx.x * kWords + bit / 32] = word;
}

// A thread a word of 32 voxels.
__global__ void set_filled(Brick* bricks, int count, const std::uint32_t* fill, unsigned long long* filled) {
    const int n = thread_index();
    if (n >= count * kWords || fill[n] == 0) return;
    reinterpret_cast<std::uint32_t*>(bricks[n / kWords].occupancy)[n % kWords] |= fill[n];
    atomicAdd(filled, static_cast<unsigned long long>(__popc(fill[n])));
}

}  // namespace

void fill_surrounded(const Stream& stream, const DeviceVolume& volume, int radius, int min_lines,
                     DeviceBuffer<std::uint32_t>& fill, unsigned long long* filled) {
    const int bricks = volume.brick_count();
    if (bricks == 0) return;
    fill.resize(static_cast<std::size_t>(bricks) * kWords);
    find_surrounded<<<bricks, kBrickVoxels, 0, stream.get()>>>(volume.bricks(), volume.table(), radius,
                                                               min_lines, fill.data());
    set_filled<<<blocks(fill.size()), kThreads, 0, stream.get()>>>(volume.bricks(), bricks, fill.data(),
                                                                   filled);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
