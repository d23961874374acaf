// Subject or shadow: what the other cameras say of doubtful pixels, by the rule of shared/kde_shadow.h.
#include <algorithm>

#include "kernels/cuda/segmentation_steps.h"

namespace kinevox::kernels::cuda {
namespace {

using kde::kCellPixels;

// A camera's scene with what its votes say of the subject.
__device__ kde::SceneView scene_of(const SegmentData& d) {
    constexpr int kBlock = kde::kVoteBlock_px;
    kde::SceneView scene = *d.scene;
    const int* box = d.state->vote_box;
    scene.sees = box[0] < box[2] && box[1] < box[3];
    if (scene.sees)
        kde::bounds_around({kBlock * box[0], kBlock * box[1], kBlock * box[2], kBlock * box[3]},
                           d.camera.width, d.camera.height, d.floor.directions, d.floor.columns, d.floor_rows,
                           scene.bounds);
    return scene;
}

// The support of each block of kSupportBlock_px that has doubtful pixels: a thread a sample of its ray.
__global__ void support_kernel(const SegmentData* __restrict__ cameras) {
    constexpr int kBlock = kde::kSupportBlock_px, kSamples = kde::kSupportSamples;
    constexpr int kVotes = kBlock / kde::kVoteBlock_px;
    static_assert(sizeof(kde::SceneView) % sizeof(Word) == 0);
    __shared__ Word memory[kde::kMaxFloorViews * sizeof(kde::SceneView) / sizeof(Word)];
    auto* const views = reinterpret_cast<kde::SceneView*>(memory);  // which shared memory cannot construct
    const SegmentData& d = cameras[blockIdx.z];
    if (d.other_count == 0) return;
    if (static_cast<int>(threadIdx.x) < d.other_count)
        views[threadIdx.x] = scene_of(cameras[d.others[threadIdx.x]]);
    __syncthreads();
    const int n = thread_index() / kSamples, sample = thread_index() % kSamples;
    const int row = n / d.support_columns(), column = n % d.support_columns();
    bool doubtful = false;
    if (row < d.support_rows())
        for (int i = 0; i < kVotes * kVotes; ++i) {
            const int y = row * kVotes + i / kVotes, x = column * kVotes + i % kVotes;
            if (y >= d.vote_rows() || x >= d.vote_columns()) continue;
            const int vote = d.votes[y * d.vote_columns() + x];
            doubtful = doubtful || (vote >= kde::kMinJudgedVote && vote < kde::kMaxVote);
        }
    const int count = d.other_count;
    const auto view = [&](int i) -> const kde::SceneView& { return views[i]; };
    int best = -kde::kMaxVote * count - 1;
    float support = kde::kUnknownSupport;
    bool votes = false;
    if (doubtful) {
        kde::SupportRay ray;
        const bool known = kde::support_ray(d.floor, d.camera, kde::block_centre<kBlock>(column * kBlock),
                                            kde::block_centre<kBlock>(row * kBlock), ray);
        if (known && kde::confine_to_views(ray, count, view)) {
            votes = ray.near < ray.far;
            support = kde::kNoSupport;
            if (votes) best = kde::votes_on_sample(ray, sample, count, best, view);
        }
    }
    for (int step = kSamples / 2; step > 0; step /= 2)
        best = max(best, __shfl_xor_sync(0xffffffffu, best, step));
    if (doubtful && sample == 0) d.support[n] = votes ? kde::support_of_votes(best, count) : support;
}

// What the other cameras see of the floor behind a tile's blocks of kFloorBlock_px; negative: not known.
constexpr int kFloorBlocks = kCellPixels / kde::kFloorBlock_px;
static_assert(kTileRows == kde::kFloorBlock_px);
struct FloorLights {
    unsigned asked;  // a bit per block
    float light[kde::kMaxFloorViews][kFloorBlocks];
};

// Looks up the blocks that are asked for, a thread a block and camera.
template <int kChannels>
__device__ void look_up(const SegmentData& d, const SegmentData* cameras, const Tile& tile,
                        FloorLights& lights) {
    const int view = static_cast<int>(threadIdx.x) / kFloorBlocks,
              block = static_cast<int>(threadIdx.x) % kFloorBlocks;
    if (view >= d.other_count || !(lights.asked >> block & 1)) return;
    float floor_x, floor_y, light = -1;
    const int x = tile.k * kCellPixels + block * kde::kFloorBlock_px;
    if (kde::floor_point(d.floor, d.camera, kde::block_centre<kde::kFloorBlock_px>(x),
                         kde::block_centre<kde::kFloorBlock_px>(tile.y0), floor_x, floor_y))
        light =
            kde::light_of_floor<kChannels>(*cameras[d.others[view]].scene, floor_x, floor_y, d.parameters);
    lights.light[view][block] = light;
}

template <int kChannels>
__device__ kde::ShadowLogOdds<float> odds_of(const SegmentData& d, const FloorLights& lights,
                                             std::size_t cell, int y, int x, float support) {
    const std::size_t plane = cell * kChannels * kCellPixels + x % kCellPixels, at = d.at(y, x);
    const float distance =
        kde::squared_distance<kChannels>(d.values + plane, d.reference + plane, d.scale + plane);
    auto e = kde::own_evidence<kChannels, float>(
        distance, d.log_foreground[kde::histogram_bin<kChannels>(d.values + plane)],
        {d.factor + at, d.residual + at, d.neighbourhood + at, d.misfit + at, d.stride()},
        d.state->noise_factor);
    for (int n = 0; n < d.other_count; ++n)
        kde::add_floor_light(e, lights.light[n][x % kCellPixels / kde::kFloorBlock_px]);
    e.support = support;
    return kde::shadow_log_odds(e, d.parameters.shadow);
}

// Whether the rule decides a pixel. One where the subject cannot be becomes background.
__device__ bool is_doubtful(const SegmentData& d, std::size_t cell, int y, int x, float& support) {
    const std::size_t at = d.at(y, x);
    const int lane = x % kCellPixels;
    if (!in_group(d.active[cell], lane)) return false;
    if ((d.density[cell * kCellPixels + lane] >= kde::kSureDensity && !d.is_faint(y, x)) ||
        d.evidence[at] >= kde::kDoubtfulEvidence ||
        d.votes[y / kde::kVoteBlock_px * d.vote_columns() + x / kde::kVoteBlock_px] < kde::kMinJudgedVote)
        return false;
    support = d.support[y / kde::kSupportBlock_px * d.support_columns() + x / kde::kSupportBlock_px];
    if (support >= kde::kMinSupport || kde::is_lighter(d.factor + at, d.stride())) return true;
    d.evidence[at] = -d.parameters.limit;
    return false;
}

// Judges the pixels of active tiles, and counts per block those that the votes would change.
template <int kChannels>
__global__ void __launch_bounds__(kTileThreads) shadow_kernel(const SegmentData* __restrict__ cameras) {
    __shared__ FloorLights lights;
    const SegmentData& d = cameras[blockIdx.z];
    if (d.other_count == 0) return;
    const int tiles = d.state->active_listed;
    for (int n = static_cast<int>(blockIdx.x); n < tiles; n += static_cast<int>(gridDim.x)) {
        const Tile tile(d, d.active_tiles[n]);
        const int x = tile.x(), y = tile.y();
        const std::size_t cell = d.work.holds(y, tile.k) ? d.cell(y, tile.k) : 0;
        float support = 0;
        if (threadIdx.x == 0) lights.asked = 0;
        const bool doubtful = d.work.holds(y, tile.k) && x < d.width && is_doubtful(d, cell, y, x, support);
        if (!__syncthreads_or(doubtful)) continue;
        if (doubtful) atomicOr(&lights.asked, 1u << tile.lane / kde::kFloorBlock_px);
        __syncthreads();
        look_up<kChannels>(d, cameras, tile, lights);
        __syncthreads();
        if (doubtful) {
            const auto odds = odds_of<kChannels>(d, lights, cell, y, x, support);
            d.evidence[d.at(y, x)] = odds.own;
            d.voted[d.at(y, x)] = odds.voted;
            if (odds.changed()) {
                atomicAdd(d.changed + y / kde::kVoteBlock_px * d.vote_columns() + x / kde::kVoteBlock_px, 1);
                atomicAdd(&d.state->changed, 1);
            }
        }
        __syncthreads();
    }
}

// A thread a block of the whole image: marks the square around it if the votes change enough of its pixels.
__global__ void limb_kernel(const SegmentData* __restrict__ cameras) {
    const SegmentData& d = cameras[blockIdx.z];
    if (d.other_count == 0 || d.state->changed == 0) return;
    const int n = thread_index(), columns = d.vote_columns(), rows = d.vote_rows();
    const int row = n / columns, column = n % columns;
    if (row >= rows) return;
    const int radius = kde::voted_radius(d.state->subject_blocks);
    const int x0 = max(column - radius, 0), x1 = min(column + radius + 1, columns), y0 = max(row - radius, 0),
              y1 = min(row + radius + 1, rows);
    int changed = 0;
    for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x) changed += d.changed[y * columns + x];
    if (!kde::is_limb(changed, radius)) return;
    for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x) atomicOr(d.added + y * columns + x, 1);
}

}  // namespace

void queue_shadows(const Stream& stream, const FrameSet& cameras, int count) {
    if (std::all_of(cameras.host.begin(), cameras.host.begin() + count,
                    [](const SegmentData& d) { return d.other_count == 0; }))
        return;  // the rule needs a second view of the floor
    const auto z = static_cast<unsigned>(count);
    const unsigned samples = kde::kSupportSamples * max_of(cameras, count, [](const SegmentData& d) {
                                 return d.support_columns() * d.support_rows();
                             });
    support_kernel<<<dim3((samples + kThreads - 1) / kThreads, 1, z), kThreads, 0, stream.get()>>>(
        cameras.device);
    if (cameras.channels == 1) {
        shadow_kernel<1><<<tile_lists(cameras, count), kTileThreads, 0, stream.get()>>>(cameras.device);
    } else {
        shadow_kernel<3><<<tile_lists(cameras, count), kTileThreads, 0, stream.get()>>>(cameras.device);
    }
    const unsigned blocks =
        max_of(cameras, count, [](const SegmentData& d) { return d.vote_columns() * d.vote_rows(); });
    limb_kernel<<<dim3((blocks + kThreads - 1) / kThreads, 1, z), kThreads, 0, stream.get()>>>(
        cameras.device);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
