// The rounds of voxel colouring, step for step as kernels/cpu/colouring.cc: each round reads one occupancy
// and writes another one, so that no order of threads shows.
#include "kernels/cuda/bricks.cuh"
#include "kernels/cuda/volume.h"

namespace kinevox::kernels::cuda {
namespace {

constexpr int kWords = kBrickVoxels / 32;  // of a brick's occupancy

__device__ bool sees(const VoxelCell& at, float front_m, float facing, float voxel_m) {
    return at.depth_m <= front_m + seen_within(facing, voxel_m);
}

// Occupied voxels in the cube of 2 * radius + 1 around a voxel of the brick.
__device__ int count_support(const BrickRows& rows, int bit, int radius) {
    const int x = (bit & 7) + kBrickEdge, y = (bit >> 3 & 7) + kBrickEdge, z = (bit >> 6) + kBrickEdge;
    const std::uint32_t row_mask = (1u << (2 * radius + 1)) - 1;
    int count = 0;
    for (int cz = z - radius; cz <= z + radius; ++cz) {
        for (int cy = y - radius; cy <= y + radius; ++cy)
            count += __popc(rows[cz][cy] >> (x - radius) & row_mask);
    }
    return count;
}

// Whether a surface voxel goes: every ray through it has enough of the volume to spare it, and it is thin or
// the views that see it disagree on its colour.
__device__ bool goes(const VolumeJob& job, const BrickPosition& brick, int bit, unsigned open, bool thin) {
    const CarvingRules& rules = job.rules;
    const CellColour* seen[kMaxViews];
    int count = 0;
    bool differ = false;
    float normal[3];
    open_normal(open, normal);
    for (int v = 0; v < job.view_count; ++v) {
        const VolumeView& view = job.views[v];
        const VoxelCell at = cell_of(job.lattice, brick, bit, view.camera, job.view_states[v]);
        if (at.cell < 0) continue;
        const DepthPair depths = view.depths[at.cell];
        if (depths.back_m - depths.front_m < rules.min_ray_length_m) return false;
        if (thin || differ || !rules.by_colour ||
            !sees(at, depths.front_m, facing_of(view.camera, normal), rules.voxel_m))
            continue;
        const CellColour& colour = view.colours[at.cell];
        if (!colour.filled) continue;
        for (int other = 0; other < count; ++other) differ = differ || disagree(colour, *seen[other]);
        seen[count++] = &colour;
    }
    return thin || differ;
}

// Whether the round before took a voxel from the brick or from one of the 26 around it: elsewhere the answer
// would be the same again.
__device__ bool changed_around(const VolumeJob& job, int brick, const std::uint8_t* changed) {
    const int n = static_cast<int>(threadIdx.x);
    if (n >= 27) return false;
    const int found = brick_around(job, job.positions[brick], n);
    return found >= 0 && changed[found] != 0;
}

// A block a brick, from occupancy[now] into the other one. `round`: from 1 on, of this wait.
__global__ void __launch_bounds__(kBrickThreads)
    carve_round(const VolumeJob* __restrict__ job, int now, int round, bool first) {
    __shared__ BrickSurface surface;
    __shared__ BrickRows rows;
    __shared__ std::uint32_t marked[kWords];
    __shared__ int gone;
    if (job->state->carved[round - 1] == 0) return;
    const CarvingRules& rules = job->rules;
    const int thread = static_cast<int>(threadIdx.x), bricks = job->state->bricks;
    const std::uint8_t* const changed_before = job->changed[(round + 1) % 2];
    for (int n = static_cast<int>(blockIdx.x); n < bricks; n += static_cast<int>(gridDim.x)) {
        const bool changed = __syncthreads_or(first || changed_around(*job, n, changed_before));
        if (thread < kWords) marked[thread] = 0;
        if (thread == 0) gone = 0;
        if (changed) {
            find_surface(*job, job->occupancy[now], n, true, surface);
            if (rules.min_support_count > 0) {
                make_rows(surface.around, rows);
                __syncthreads();
            }
            const BrickPosition brick = job->positions[n];
            for (int i = thread; i < surface.count; i += kBrickThreads) {
                const int bit = surface.voxels[i];
                const bool thin = rules.min_support_count > 0 &&
                                  count_support(rows, bit, rules.support_radius) < rules.min_support_count;
                if (goes(*job, brick, bit, open_sides(surface, bit), thin))
                    atomicOr(marked + bit / 32, 1u << bit % 32);
            }
        }
        __syncthreads();
        if (thread < kWords) {
            const std::size_t word = static_cast<std::size_t>(n) * kWords + thread;
            reinterpret_cast<std::uint32_t*>(job->occupancy[1 - now])[word] =
                reinterpret_cast<const std::uint32_t*>(job->occupancy[now])[word] & ~marked[thread];
            if (marked[thread] != 0) atomicAdd(&gone, __popc(marked[thread]));
        }
        __syncthreads();
        if (thread == 0) {
            job->changed[round % 2][n] = gone > 0;
            if (gone > 0) atomicAdd(job->state->carved + round, static_cast<unsigned long long>(gone));
        }
    }
}

// More rounds follow on the last one.
__global__ void continue_rounds(const VolumeJob* __restrict__ job) {
    unsigned long long* const carved = job->state->carved;
    carved[0] = carved[kMaxRounds];
    for (int round = 1; round <= kMaxRounds; ++round) carved[round] = 0;
    for (int n = 0; n < job->view_count; ++n)
        for (unsigned long long& count : job->view_states[n].counts) count = 0;
}

// By one block: where each brick's voxels begin in the list of colours.
__global__ void __launch_bounds__(kScanThreads) place_colours(const VolumeJob* __restrict__ job) {
    __shared__ int warp_sums[32];
    int* const surface = job->surface;
    const int total = scan_by_block(
        job->state->bricks, warp_sums, [&](int n) { return surface[n]; },
        [&](int n, int before) { surface[n] = before; });
    if (threadIdx.x == 0) job->state->voxels = job->state->needed.voxels = total;
}

__device__ Colour colour_of(const VolumeJob& job, const BrickPosition& brick, int bit, unsigned open) {
    float normal[3], sum[3] = {}, weights = 0;
    open_normal(open, normal);
    for (int v = 0; v < job.view_count; ++v) {
        const VolumeView& view = job.views[v];
        const ViewState& state = job.view_states[v];
        if (!view.image) continue;
        const VoxelCell at = cell_of(job.lattice, brick, bit, view.camera, state);
        if (at.cell < 0) continue;
        const float facing = facing_of(view.camera, normal);
        float weight = colour_weight(facing, at.depth_m);
        if (!sees(at, view.depths[at.cell].front_m, facing, job.lattice.voxel_m)) weight *= kHiddenWeight;
        const std::uint8_t* mean = view.means + 3 * mean_index(at.cell, state.width);
        for (int c = 0; c < 3; ++c) sum[c] += weight * static_cast<float>(mean[c]);
        weights += weight;
    }
    Colour colour;
    if (weights > 0) {
        colour.b = static_cast<std::uint8_t>(sum[0] / weights + 0.5f);
        colour.g = static_cast<std::uint8_t>(sum[1] / weights + 0.5f);
        colour.r = static_cast<std::uint8_t>(sum[2] / weights + 0.5f);
    }
    return colour;
}

__device__ void store_brick(const VolumeJob& job, int now, int n) {
    const int k = static_cast<int>(threadIdx.x);
    Brick& out = job.out[n];
    if (k < kBrickEdge) out.occupancy[k] = job.occupancy[now][static_cast<std::size_t>(n) * kBrickEdge + k];
    if (k != 0) return;
    const BrickPosition brick = job.positions[n];
    out.x = brick.x, out.y = brick.y, out.z = brick.z, out.padding = 0;
}

// A block a brick.
__global__ void __launch_bounds__(kBrickThreads) paint(const VolumeJob* __restrict__ job, int now) {
    __shared__ BrickSurface surface;
    const int bricks = job->state->bricks;
    Colour* const colours = reinterpret_cast<Colour*>(job->out + bricks);
    for (int n = static_cast<int>(blockIdx.x); n < bricks; n += static_cast<int>(gridDim.x)) {
        find_surface(*job, job->occupancy[now], n, false, surface);
        store_brick(*job, now, n);
        const BrickPosition brick = job->positions[n];
        for (int i = static_cast<int>(threadIdx.x); i < surface.count; i += kBrickThreads) {
            const int place = job->surface[n] + i, bit = surface.voxels[i];
            if (place < job->room.voxels)
                colours[place] = colour_of(*job, brick, bit, open_sides(surface, bit));
        }
    }
}

__global__ void store_bricks(const VolumeJob* __restrict__ job, int now) {
    const int bricks = job->state->bricks;
    for (int n = static_cast<int>(blockIdx.x); n < bricks; n += static_cast<int>(gridDim.x))
        store_brick(*job, now, n);
}

}  // namespace

// Looks and rounds take turns with two images and two occupancies; an even kMaxRounds keeps those of
// VolumeJob::changed in turn, too, when more rounds follow.
void queue_rounds(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int views, int now,
                  int rounds, bool continued, int look) {
    static_assert(kMaxRounds % 2 == 0);
    if (continued) continue_rounds<<<1, 1, 0, stream.get()>>>(job);
    for (int round = 1; round <= rounds; ++round, now = 1 - now) {
        queue_look(stream, job, blocks, views, now, round - 1, look++);
        carve_round<<<blocks.bricks, kBrickThreads, 0, stream.get()>>>(job, now, round,
                                                                       round == 1 && !continued);
    }
    queue_look(stream, job, blocks, views, now, rounds, look);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_results(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int views,
                   int now) {
    place_colours<<<1, kScanThreads, 0, stream.get()>>>(job);
    paint<<<blocks.bricks, kBrickThreads, 0, stream.get()>>>(job, now);
    queue_iou(stream, job, blocks, views);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_bricks(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int now) {
    store_bricks<<<blocks.bricks, kBrickThreads, 0, stream.get()>>>(job, now);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
