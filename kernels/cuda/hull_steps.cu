// The hull on the device: super-blocks, bricks, then a block of 512 threads a brick that is not empty.
#include "kernels/cuda/bricks.cuh"
#include "kernels/cuda/volume.h"

namespace kinevox::kernels::cuda {
namespace {

constexpr int kLatticeBlocks = 256;  // they share the lattice's bricks

// A block of `edge` bricks a side whose first brick is (bx, by, bz).
__device__ BlockState decide_bricks(const HullQuestion& q, const Lattice& lattice, int bx, int by, int bz,
                                    int edge) {
    const float voxel = lattice.voxel_m;
    const float half = 0.5f * static_cast<float>(edge * kBrickEdge) * voxel;
    const int brick[3] = {bx, by, bz};
    float centre[3];
    for (int axis = 0; axis < 3; ++axis) {
        centre[axis] = lattice.origin[axis] + static_cast<float>(brick[axis] * kBrickEdge) * voxel + half;
    }
    return decide_block(q.maps, q.views, q.min_views, centre[0], centre[1], centre[2], half - 0.5f * voxel);
}

// Voxel `bit` (z * 64 + y * 8 + x) of a brick whose first voxel's centre is (x, y, z); rounded as in
// carve_brick() of the CPU form.
__device__ bool voxel_inside(const HullQuestion& q, float voxel, float x, float y, float z, int bit) {
    const float along = static_cast<float>(bit & 7) * voxel;
    y += static_cast<float>(bit >> 3 & 7) * voxel;
    z += static_cast<float>(bit >> 6) * voxel;
    int misses = 0, contain = 0;
    for (int n = 0; n < q.views; ++n) {
        const HullMaps& view = q.maps[n];
        const Projector& c = view.camera;
        CameraPoint p = to_camera(c, x, y, z);
        p.x += along * c.r[0], p.y += along * c.r[3], p.z += along * c.r[6];
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

__global__ void decide_super_blocks(const VolumeJob* __restrict__ job) {
    const Grid3& supers = job->supers;
    for (int n = thread_index(); n < supers.count(); n += thread_count())
        job->super_states[n] = decide_bricks(job->hull, job->lattice, n % supers.x * kSuperEdge,
                                             n / supers.x % supers.y * kSuperEdge,
                                             n / (supers.x * supers.y) * kSuperEdge, kSuperEdge);
}

__global__ void decide_each_brick(const VolumeJob* __restrict__ job) {
    const Grid3 &grid = job->grid, &supers = job->supers;
    for (int n = thread_index(); n < grid.count(); n += thread_count()) {
        const int x = n % grid.x, y = n / grid.x % grid.y, z = n / (grid.x * grid.y);
        BlockState state =
            job->super_states[(z / kSuperEdge * supers.y + y / kSuperEdge) * supers.x + x / kSuperEdge];
        if (state == BlockState::kMixed) state = decide_bricks(job->hull, job->lattice, x, y, z, 1);
        job->states[n] = state;
    }
}

// Bricks that are not empty among entries [first, last) of the lattice.
__device__ int count_bricks(const VolumeJob& job, int first, int last) {
    int count = 0;
    for (int n = first; n < last; ++n) count += job.states[n] != BlockState::kEmpty;
    return count;
}

// By one block.
__global__ void __launch_bounds__(kScanThreads) place_groups(const VolumeJob* __restrict__ job) {
    __shared__ int warp_sums[32];
    const int bricks = job->grid.count(), groups = (bricks + kGroup - 1) / kGroup;
    const int total = scan_by_block(
        groups, warp_sums,
        [&](int n) { return count_bricks(*job, n * kGroup, min((n + 1) * kGroup, bricks)); },
        [&](int n, int before) { job->group_places[n] = before; });
    if (threadIdx.x == 0) {
        job->state->bricks = min(total, job->room.bricks);
        job->state->needed.bricks = total;
    }
}

// A thread an entry of the index. Bricks without room do not exist.
__global__ void list_bricks(const VolumeJob* __restrict__ job) {
    const Grid3& grid = job->grid;
    for (int n = thread_index(); n < job->index_size(); n += thread_count()) {
        const int x = n % (grid.x + 2) - 1, y = n / (grid.x + 2) % (grid.y + 2) - 1,
                  z = n / ((grid.x + 2) * (grid.y + 2)) - 1;
        const bool inside = x >= 0 && y >= 0 && z >= 0 && x < grid.x && y < grid.y && z < grid.z;
        const int brick = (z * grid.y + y) * grid.x + x;
        int place = -1;
        if (inside && job->states[brick] != BlockState::kEmpty) {
            const int group = brick / kGroup;
            place = job->group_places[group] + count_bricks(*job, group * kGroup, brick);
            if (place >= job->room.bricks) place = -1;
        }
        job->index[n] = place;
        if (place < 0) continue;
        job->positions[place] = {static_cast<std::int16_t>(x), static_cast<std::int16_t>(y),
                                 static_cast<std::int16_t>(z), 0};
    }
}

__device__ std::uint32_t* words_of(std::uint64_t* occupancy, int brick) {
    return reinterpret_cast<std::uint32_t*>(occupancy + static_cast<std::size_t>(brick) * kBrickEdge);
}

// One block a brick, one thread a voxel; a warp's votes are 32 bits of the occupancy.
__global__ void carve_bricks(const VolumeJob* __restrict__ job) {
    const int bit = static_cast<int>(threadIdx.x), bricks = job->state->bricks;
    for (int n = static_cast<int>(blockIdx.x); n < bricks; n += static_cast<int>(gridDim.x)) {
        const BrickPosition brick = job->positions[n];
        const BlockState state = job->states[(brick.z * job->grid.y + brick.y) * job->grid.x + brick.x];
        const float voxel = job->lattice.voxel_m;
        const auto first = [&](int axis, int place) {
            return job->lattice.origin[axis] + (static_cast<float>(place * kBrickEdge) + 0.5f) * voxel;
        };
        const bool inside =
            state == BlockState::kFull ||
            voxel_inside(job->hull, voxel, first(0, brick.x), first(1, brick.y), first(2, brick.z), bit);
        const unsigned votes = __ballot_sync(0xffffffffu, inside);
        if (bit % 32 == 0) words_of(job->occupancy[0], n)[bit / 32] = votes;
    }
}

__global__ void clear_index(const VolumeJob* __restrict__ job) {
    for (int n = thread_index(); n < job->index_size(); n += thread_count()) job->index[n] = -1;
}

// A thread a slice.
__global__ void take_bricks(const VolumeJob* __restrict__ job) {
    const int slices = job->state->bricks * kBrickEdge;
    for (int n = thread_index(); n < slices; n += thread_count()) {
        const int brick = n / kBrickEdge, k = n % kBrickEdge;
        const Brick& from = job->given[brick];
        job->occupancy[0][n] = from.occupancy[k];
        if (k != 0) continue;
        job->positions[brick] = {from.x, from.y, from.z, 0};
        job->index[job->at(from.x, from.y, from.z)] = brick;
    }
}

// One block a brick, one thread a voxel: clears what sticks out of the sharp silhouettes.
__global__ void carve_outside(const VolumeJob* __restrict__ job, int now) {
    __shared__ BlockState whole;
    __shared__ int gone;
    const int bit = static_cast<int>(threadIdx.x), bricks = job->state->bricks;
    for (int n = static_cast<int>(blockIdx.x); n < bricks; n += static_cast<int>(gridDim.x)) {
        const BrickPosition brick = job->positions[n];
        __syncthreads();  // all have read what the brick before left
        if (bit == 0) {
            whole = decide_bricks(job->sharp, job->lattice, brick.x, brick.y, brick.z, 1);
            gone = 0;
        }
        __syncthreads();
        if (whole == BlockState::kFull) continue;
        const float voxel = job->lattice.voxel_m;
        const auto first = [&](int axis, int place) {
            return job->lattice.origin[axis] + static_cast<float>(place * kBrickEdge) * voxel + 0.5f * voxel;
        };
        const unsigned kept = __ballot_sync(
            0xffffffffu,
            voxel_inside(job->sharp, voxel, first(0, brick.x), first(1, brick.y), first(2, brick.z), bit));
        if (bit % 32 == 0) {
            std::uint32_t& word = words_of(job->occupancy[now], n)[bit / 32];
            atomicAdd(&gone, __popc(word & ~kept));
            word &= kept;
        }
        __syncthreads();
        if (bit == 0 && gone > 0)
            atomicAdd(&job->state->carved_by_sharp, static_cast<unsigned long long>(gone));
    }
}

}  // namespace

void queue_hull(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks) {
    decide_super_blocks<<<kLatticeBlocks / 4, kThreads / 4, 0, stream.get()>>>(job);
    decide_each_brick<<<kLatticeBlocks, kThreads / 2, 0, stream.get()>>>(job);
    place_groups<<<1, kScanThreads, 0, stream.get()>>>(job);
    list_bricks<<<kLatticeBlocks, kThreads, 0, stream.get()>>>(job);
    carve_bricks<<<blocks.bricks, kBrickVoxels, 0, stream.get()>>>(job);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_given(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks) {
    clear_index<<<kLatticeBlocks, kThreads, 0, stream.get()>>>(job);
    take_bricks<<<blocks.bricks, kBrickThreads, 0, stream.get()>>>(job);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_sharp(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int now) {
    carve_outside<<<blocks.bricks, kBrickVoxels, 0, stream.get()>>>(job, now);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
