// From the density to the evidence of each pixel, its smoothing and the decision; blocks work on the
// listed tiles of kTileRows rows of a cell.
#include "kernels/cuda/segmentation_steps.h"

namespace kinevox::kernels::cuda {
namespace {

using kde::kCellPixels;

static_assert(kTileRows + kSurroundings <= kPlaneMargin && kTileRows == kde::kVoteBlock_px);

// A tile and kSurroundings columns on each side.
constexpr int kWideColumns = kCellPixels + 2 * kSurroundings;
constexpr int kSums = 5;
using ColumnSums = float[kSums][kTileRows][kWideColumns];

// Of each column around a tile's rows, in the planes that the neighbourhoods add up.
__device__ void sum_columns(const SegmentData& d, const Tile& tile, ColumnSums& sums) {
    const float* planes[kSums] = {d.weighted_value, d.weighted_energy, d.product, d.energy, d.square};
    for (int n = static_cast<int>(threadIdx.x); n < kTileRows * kWideColumns; n += kTileThreads) {
        const int row = n / kWideColumns, column = n % kWideColumns;
        if (tile.y0 + row >= d.height + kSurroundings) break;  // not looked at
        const std::size_t at = d.at(tile.y0 + row, tile.k * kCellPixels - kSurroundings + column),
                          stride = d.stride();
#pragma unroll
        for (int p = 0; p < kSums; ++p) {
            const int radius = p < 2 ? kde::kLightRadius : kde::kPatchRadius;
            const float* from = planes[p] + at - radius * stride;
            float sum = from[0];
            for (int dy = 1; dy <= 2 * radius; ++dy) sum += from[dy * stride];
            sums[p][row][column] = sum;
        }
    }
}

// The light of the window around each pixel near an active one, and the misfit of one light to its patch;
// summed in the CPU form's order, columns first.
__global__ void __launch_bounds__(kTileThreads) surroundings_kernel(const SegmentData* __restrict__ cameras) {
    constexpr int kLight = kde::kLightRadius, kPatch = kde::kPatchRadius;
    __shared__ ColumnSums columns;
    const SegmentData& d = cameras[blockIdx.z];
    if (!d.look) return;
    const int tiles = d.state->near_listed;
    for (int n = static_cast<int>(blockIdx.x); n < tiles; n += static_cast<int>(gridDim.x)) {
        const Tile tile(d, d.near_tiles[n]);
        sum_columns(d, tile, columns);
        __syncthreads();
        const auto sum = [&](int p, int radius) {
            float total = 0;
            for (int dx = -radius; dx <= radius; ++dx)
                total += columns[p][tile.row][tile.lane + kSurroundings + dx];
            return total;
        };
        if (tile.y() < d.height + kSurroundings) {
            const float value = sum(0, kLight), light = sum(1, kLight);
            const float product = sum(2, kPatch), energy = sum(3, kPatch);
            const float left = (sum(4, kPatch) - product * product / (energy > 1e-6f ? energy : 1e-6f)) *
                               (1.0f / static_cast<float>(49 * d.channels));
            d.neighbourhood[d.at(tile.y(), tile.x())] = light > 0 ? value / light : 1.0f;
            d.misfit[d.at(tile.y(), tile.x())] = left > 0 ? left : 0;
        }
        __syncthreads();
    }
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

// The evidence of a tile's active pixels, and the votes of its blocks, which are one row.
template <int kChannels>
__device__ void evidence_of_tile(const SegmentData& d, const Tile& tile) {
    constexpr int kBlock = kde::kVoteBlock_px, kBlocks = kCellPixels / kBlock;
    __shared__ int votes[kTileRows][kBlocks];
    const int x = tile.x(), y = tile.y();
    int vote = 0;
    if (d.work.holds(y, tile.k) && in_group(d.active[d.cell(y, tile.k)], tile.lane)) {
        const std::size_t cell = d.cell(y, tile.k);
        const float evidence = evidence_at<kChannels>(d, cell, y, x);
        d.evidence[d.at(y, x)] = evidence;
        const int density = d.density[cell * kCellPixels + tile.lane];
        if (x < d.width) vote = 1 + kde::pixel_vote(d.is_faint(y, x) ? 0 : density, evidence);
    }
    if (!d.has_camera) return;
    vote += __shfl_xor_sync(0xffffffffu, vote, 1);
    vote += __shfl_xor_sync(0xffffffffu, vote, 2);
    if (tile.lane % kBlock == 0) votes[tile.row][tile.lane / kBlock] = vote;
    __syncthreads();
    if (threadIdx.x < 32) {
        const int n = static_cast<int>(threadIdx.x), row = tile.y0 / kBlock, column = tile.k * kBlocks + n;
        int sum = -kde::kMaxVote;
        if (n < kBlocks && column < d.vote_columns()) {
            for (int r = 0; r < kTileRows; ++r) sum += votes[r][n];
            d.votes[static_cast<std::size_t>(row) * d.vote_columns() + column] =
                static_cast<std::int8_t>(sum);
        }
        add_to_subject(d, row, tile.k * kBlocks, sum);
    }
    __syncthreads();
}

template <int kChannels>
__global__ void __launch_bounds__(kTileThreads) evidence_kernel(const SegmentData* __restrict__ cameras) {
    const SegmentData& d = cameras[blockIdx.z];
    if (!d.look) return;
    const int tiles = d.state->active_listed;
    for (int n = static_cast<int>(blockIdx.x); n < tiles; n += static_cast<int>(gridDim.x))
        evidence_of_tile<kChannels>(d, Tile(d, d.active_tiles[n]));
}

// Smooths a tile's evidence, with the votes where they are taken over, and decides its pixels in the active
// box, of each row those from its first active group to its last one.
__device__ void decide_tile(const SegmentData& d, const Tile& tile, const CellRange& box, bool voted) {
    constexpr int kRadius = 2, kRows = kTileRows + 2 * kRadius, kColumns = kCellPixels + 2 * kRadius;
    __shared__ float evidence[kRows][kColumns];
    __shared__ float across[kTileRows][kColumns];
    for (int n = static_cast<int>(threadIdx.x); n < kRows * kColumns; n += kTileThreads) {
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
    for (int n = static_cast<int>(threadIdx.x); n < kTileRows * kColumns; n += kTileThreads) {
        const int row = n / kColumns, column = n % kColumns;
        const auto e = [&](int dy) { return evidence[row + kRadius + dy][column]; };
        across[row][column] = w0 * (e(-2) + e(2)) + w1 * (e(-1) + e(1)) + w2 * e(0);
    }
    __syncthreads();
    const int x = tile.x(), y = tile.y();
    const int group = x / kde::kGroupPixels;
    const bool inside =
        box.holds(y, tile.k) && group >= d.group_spans[2 * y] && group < d.group_spans[2 * y + 1];
    const float* a = across[tile.row] + tile.lane;
    const float smoothed = w0 * (a[0] + a[4]) + w1 * (a[1] + a[3]) + w2 * a[2];
    const unsigned sharp = __ballot_sync(0xffffffffu, inside && x < d.width && smoothed > d.sharp_from);
    const unsigned loose = __ballot_sync(0xffffffffu, inside && x < d.width && smoothed > d.loose_from);
    if (inside) {
        d.smoothed[d.at(y, x)] = smoothed;
        const int step = static_cast<int>(smoothed * (127.5f / d.parameters.limit) + 127.5f);
        d.result_probability[d.result_cell(y, tile.k) * kCellPixels + tile.lane] =
            d.probability_of[min(max(step, 0), 255)];
    }
    if (tile.lane % 32 != 0 || !box.holds(y, tile.k)) return;
    const std::size_t half = 2 * d.cell(y, tile.k) + tile.lane / 32;
    reinterpret_cast<unsigned*>(d.sharp)[half] = sharp;
    reinterpret_cast<unsigned*>(d.loose)[half] = loose;
}

// Elsewhere in the box the masks and the probability are 0 already.
__global__ void __launch_bounds__(kTileThreads) decide_kernel(const SegmentData* __restrict__ cameras) {
    const SegmentData& d = cameras[blockIdx.z];
    const CellRange box = d.state->box;
    const bool voted = d.state->changed > 0;
    const int tiles = d.state->near_listed;
    for (int n = static_cast<int>(blockIdx.x); n < tiles; n += static_cast<int>(gridDim.x)) {
        const Tile tile(d, d.near_tiles[n]);
        if (tile.k < box.k0 || tile.k >= box.k1) continue;
        decide_tile(d, tile, box, voted);
        __syncthreads();
    }
}

}  // namespace

void queue_evidence(const Stream& stream, const FrameSet& cameras) {
    const int count = static_cast<int>(cameras.host.size());
    const dim3 tiles = tile_lists(cameras, count);
    surroundings_kernel<<<tiles, kTileThreads, 0, stream.get()>>>(cameras.device);
    if (cameras.channels == 1) {
        evidence_kernel<1><<<tiles, kTileThreads, 0, stream.get()>>>(cameras.device);
    } else {
        evidence_kernel<3><<<tiles, kTileThreads, 0, stream.get()>>>(cameras.device);
    }
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_decisions(const Stream& stream, const FrameSet& cameras, int count) {
    decide_kernel<<<tile_lists(cameras, count), kTileThreads, 0, stream.get()>>>(cameras.device);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
