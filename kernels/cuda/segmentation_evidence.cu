// From the density to the evidence of each pixel, its smoothing and the decision; blocks work on tiles of
// kTileRows rows of a cell, and those without an active cell return at once.
#include <algorithm>

#include "kernels/cuda/segmentation_steps.h"

namespace kinevox::kernels::cuda {
namespace {

using kde::kCellPixels;

// As far around an active pixel as it is looked at; each look sees as far again.
constexpr int kSurroundings = std::max(kde::kLightRadius, kde::kPatchRadius);
constexpr int kMarginTiles = (kSurroundings + kTileRows - 1) / kTileRows;
static_assert(kMarginTiles * kTileRows + kSurroundings <= kPlaneMargin);
static_assert(kTileRows == kde::kVoteBlock_px);

// The light of the window around each pixel near an active one, and the misfit of one light to its patch;
// summed in the CPU form's order, columns first.
__global__ void __launch_bounds__(kTileThreads) surroundings_kernel(const SegmentData* __restrict__ cameras) {
    constexpr int kLight = kde::kLightRadius, kPatch = kde::kPatchRadius;
    constexpr int kColumns = kCellPixels + 2 * kSurroundings;
    __shared__ float columns[5][kTileRows][kColumns];
    const SegmentData& d = cameras[blockIdx.z];
    const Tile tile(d.work, kMarginTiles * kTileRows, 1);
    if (!d.look || tile.k > d.work.k1 || tile.y0 >= d.work.y1 + kSurroundings) return;
    if (!active_near(d, tile, kSurroundings, 1)) return;
    const float* planes[5] = {d.weighted_value, d.weighted_energy, d.product, d.energy, d.square};
    for (int n = static_cast<int>(threadIdx.x); n < kTileRows * kColumns; n += kTileThreads) {
        const int row = n / kColumns, column = n % kColumns;
        if (tile.y0 + row >= d.height + kSurroundings) break;  // nobody looks there
        const std::size_t at = d.at(tile.y0 + row, tile.k * kCellPixels - kSurroundings + column),
                          stride = d.stride();
#pragma unroll
        for (int p = 0; p < 5; ++p) {
            const int radius = p < 2 ? kLight : kPatch;
            const float* from = planes[p] + at - radius * stride;
            float sum = from[0];
            for (int dy = 1; dy <= 2 * radius; ++dy) sum += from[dy * stride];
            columns[p][row][column] = sum;
        }
    }
    __syncthreads();
    if (tile.y() >= d.height + kSurroundings) return;
    const auto sum = [&](int p, int radius) {
        float total = 0;
        for (int dx = -radius; dx <= radius; ++dx)
            total += columns[p][tile.row][tile.lane + kSurroundings + dx];
        return total;
    };
    const float value = sum(0, kLight), light = sum(1, kLight);
    const float product = sum(2, kPatch), energy = sum(3, kPatch);
    const float left = (sum(4, kPatch) - product * product / (energy > 1e-6f ? energy : 1e-6f)) *
                       (1.0f / static_cast<float>(49 * d.channels));
    d.neighbourhood[d.at(tile.y(), tile.x())] = light > 0 ? value / light : 1.0f;
    d.misfit[d.at(tile.y(), tile.x())] = left > 0 ? left : 0;
}

template <int kChannels>
__device__ float evidence_at(const SegmentData& d, std::size_t cell, int y, int x) {
    constexpr int kRadius = kde::kLightRadius;
    const int lane = x % kCellPixels;
    const std::size_t at = d.at(y, x);
    const auto step_to = [&](int ox, int oy) {
        return fabsf(d.factor[at] - d.neighbourhood[d.at(y + oy, x + ox)]);
    };
    float step = step_to(0, -kRadius);
    step = fminf(step, step_to(-kRadius, 0));
    step = fminf(step, step_to(0, 0));
    step = fminf(step, step_to(kRadius, 0));
    step = fminf(step, step_to(0, kRadius));
    const std::size_t plane = cell * kChannels * kCellPixels + lane;
    const std::uint8_t density = d.density[cell * kCellPixels + lane];
    return kde::evidence<kChannels>(d.values + plane, d.reference + plane, d.scale + plane, density,
                                    d.log_lit[density], d.log_peak[cell * kCellPixels + lane], d.residual[at],
                                    step, d.log_foreground[kde::histogram_bin<kChannels>(d.values + plane)],
                                    d.parameters);
}

// Adds the blocks of a tile that lie in the subject to the box around them; by the first warp.
__device__ void add_to_subject(const SegmentData& d, int row, int first_column, int vote) {
    const unsigned subject = __ballot_sync(0xffffffffu, vote >= kde::kSubjectVote);
    if (subject == 0 || threadIdx.x != 0) return;
    CameraState& state = *d.state;
    const int first = __ffsll(static_cast<long long>(subject)) - 1;
    int last = first;
    for (int n = first; n < 32; ++n)
        if (subject >> n & 1) last = n;
    atomicMin(state.vote_box, first_column + first);
    atomicMin(state.vote_box + 1, row);
    atomicMax(state.vote_box + 2, first_column + last + 1);
    atomicMax(state.vote_box + 3, row + 1);
    atomicAdd(&state.subject_blocks, __popc(subject));
}

// The evidence of active pixels, and the votes of the blocks, one row of which is a tile.
template <int kChannels>
__global__ void __launch_bounds__(kTileThreads) evidence_kernel(const SegmentData* __restrict__ cameras) {
    constexpr int kBlock = kde::kVoteBlock_px, kBlocks = kCellPixels / kBlock;
    __shared__ int votes[kTileRows][kBlocks];
    const SegmentData& d = cameras[blockIdx.z];
    const Tile tile(d.work);
    if (!d.look || tile.k >= d.work.k1 || !active_near(d, tile, 0, 0)) return;
    const int x = tile.x(), y = tile.y();
    int vote = 0;
    if (d.work.holds(y, tile.k) && in_group(d.active[d.cell(y, tile.k)], tile.lane)) {
        const std::size_t cell = d.cell(y, tile.k);
        const float evidence = evidence_at<kChannels>(d, cell, y, x);
        d.evidence[d.at(y, x)] = evidence;
        if (x < d.width) vote = 1 + kde::pixel_vote(d.density[cell * kCellPixels + tile.lane], evidence);
    }
    if (!d.has_camera) return;
    vote += __shfl_xor_sync(0xffffffffu, vote, 1);
    vote += __shfl_xor_sync(0xffffffffu, vote, 2);
    if (tile.lane % kBlock == 0) votes[tile.row][tile.lane / kBlock] = vote;
    __syncthreads();
    if (threadIdx.x >= 32) return;
    const int n = static_cast<int>(threadIdx.x), row = tile.y0 / kBlock, column = tile.k * kBlocks + n;
    int sum = -kde::kMaxVote;
    if (n < kBlocks && column < d.vote_columns()) {
        for (int r = 0; r < kTileRows; ++r) sum += votes[r][n];
        d.votes[static_cast<std::size_t>(row) * d.vote_columns() + column] = static_cast<std::int8_t>(sum);
    }
    add_to_subject(d, row, tile.k * kBlocks, sum);
}

// A thread a camera: what the other cameras look up.
__global__ void scene_kernel(const SegmentData* __restrict__ cameras, int count) {
    const int n = static_cast<int>(threadIdx.x);
    if (n >= count || !cameras[n].look || !cameras[n].has_camera) return;
    const SegmentData& d = cameras[n];
    constexpr int kBlock = kde::kVoteBlock_px;
    const int* box = d.state->vote_box;
    kde::SceneView& scene = *d.scene;
    scene.camera = d.camera;
    scene.image = d.image;
    scene.image_stride = static_cast<std::ptrdiff_t>(d.width) * d.channels;
    scene.reference = d.reference;
    scene.scale = d.scale;
    for (int c = 0; c < 3; ++c) scene.inverse_gain[c] = d.state->gain_64[c];
    scene.channels = d.channels;
    scene.cells_per_row = d.cells_per_row;
    scene.votes = d.votes;
    scene.vote_columns = d.vote_columns();
    scene.sees = box[0] < box[2] && box[1] < box[3];
    if (!scene.sees) return;
    const Rect subject{kBlock * box[0], kBlock * box[1], kBlock * box[2], kBlock * box[3]};
    kde::bounds_around(subject, d.camera.width, d.camera.height, d.floor.directions, d.floor.columns,
                       d.floor_rows, scene.bounds);
}

// Smooths the evidence, with the votes where they are taken over, and decides each pixel of the active box.
__global__ void __launch_bounds__(kTileThreads) decide_kernel(const SegmentData* __restrict__ cameras) {
    constexpr int kRadius = 2, kRows = kTileRows + 2 * kRadius, kColumns = kCellPixels + 2 * kRadius;
    __shared__ float evidence[kRows][kColumns];
    __shared__ float across[kTileRows][kColumns];
    const SegmentData& d = cameras[blockIdx.z];
    const Tile tile(d.work);
    const CellRange& box = d.state->box;
    const int x = tile.x(), y = tile.y();
    std::uint8_t* probability = d.result_probability + d.result_cell(y, tile.k) * kCellPixels + tile.lane;
    if (tile.k < box.k0 || tile.k >= box.k1 || tile.y0 >= box.y1 || tile.y0 + kTileRows <= box.y0) {
        if (d.work.holds(y, tile.k)) *probability = 0;
        return;
    }
    const bool near = active_near(d, tile, kRadius, 1), voted = d.state->changed > 0;
    for (int n = static_cast<int>(threadIdx.x); near && n < kRows * kColumns; n += kTileThreads) {
        const int row = tile.y0 - kRadius + n / kColumns,
                  column = tile.k * kCellPixels - kRadius + n % kColumns;
        float value = d.evidence[d.at(row, column)];
        if (voted && row >= 0 && column >= 0 && row < d.height && column < d.width &&
            d.added[row / kde::kVoteBlock_px * d.vote_columns() + column / kde::kVoteBlock_px])
            value = fmaxf(value, d.voted[d.at(row, column)]);
        evidence[n / kColumns][n % kColumns] = value;
    }
    __syncthreads();
    const float w0 = d.smoothing[0], w1 = d.smoothing[1], w2 = d.smoothing[2];
    for (int n = static_cast<int>(threadIdx.x); near && n < kTileRows * kColumns; n += kTileThreads) {
        const int row = n / kColumns, column = n % kColumns;
        const auto e = [&](int dy) { return evidence[row + kRadius + dy][column]; };
        across[row][column] = w0 * (e(-2) + e(2)) + w1 * (e(-1) + e(1)) + w2 * e(0);
    }
    __syncthreads();
    const bool inside = y >= box.y0 && y < box.y1;
    float smoothed = -d.parameters.limit;
    if (near) {
        const float* a = across[tile.row] + tile.lane;
        smoothed = w0 * (a[0] + a[4]) + w1 * (a[1] + a[3]) + w2 * a[2];
    }
    const unsigned sharp = __ballot_sync(0xffffffffu, inside && x < d.width && smoothed > d.sharp_from);
    const unsigned loose = __ballot_sync(0xffffffffu, inside && x < d.width && smoothed > d.loose_from);
    if (!inside) {
        if (d.work.holds(y, tile.k)) *probability = 0;
        return;
    }
    d.smoothed[d.at(y, x)] = smoothed;
    const int step = static_cast<int>(smoothed * (127.5f / d.parameters.limit) + 127.5f);
    *probability = d.probability_of[min(max(step, 0), 255)];
    if (tile.lane % 32 != 0) return;
    const std::size_t half = 2 * d.cell(y, tile.k) + tile.lane / 32;
    reinterpret_cast<unsigned*>(d.sharp)[half] = sharp;
    reinterpret_cast<unsigned*>(d.loose)[half] = loose;
}

}  // namespace

void queue_evidence(const Stream& stream, const FrameSet& cameras) {
    const int count = static_cast<int>(cameras.host.size());
    surroundings_kernel<<<tiles_of(cameras, count, kMarginTiles, 1), kTileThreads, 0, stream.get()>>>(
        cameras.device);
    if (cameras.channels == 1) {
        evidence_kernel<1><<<tiles_of(cameras, count), kTileThreads, 0, stream.get()>>>(cameras.device);
    } else {
        evidence_kernel<3><<<tiles_of(cameras, count), kTileThreads, 0, stream.get()>>>(cameras.device);
    }
    const auto threads = static_cast<unsigned>(std::max(32, count));
    scene_kernel<<<1, threads, 0, stream.get()>>>(cameras.device, count);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_decisions(const Stream& stream, const FrameSet& cameras, int count) {
    decide_kernel<<<tiles_of(cameras, count), kTileThreads, 0, stream.get()>>>(cameras.device);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
