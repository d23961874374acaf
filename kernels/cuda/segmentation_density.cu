// From the image to the density of each pixel and the cells that may hold foreground, and the update of the
// model.
#include <algorithm>

#include "kernels/cuda/segmentation_steps.h"

namespace kinevox::kernels::cuda {
namespace {

using kde::kActiveMargin;
using kde::kCellPixels;

constexpr int kGainThreads = kMedianThreads, kGainBins = kMedianThreads;  // a thread a bin
constexpr int kClearingBlocks = 8;
constexpr int kGroups = kCellPixels / kde::kGroupPixels;  // of a cell
constexpr int kWarps = kThreads / 32;                     // of a block of kThreads

// As cpu::estimate_gain(): the values and references of a grid of the image's pixels.
struct GainGrid {
    int step, first, rows, columns;
    __device__ explicit GainGrid(const SegmentData& d) {
        step = max(1, d.height / 20), first = step / 2;
        rows = (d.height - first + step - 1) / step;
        columns = (d.width + 3) / 4;
    }
    // False where the pixel does not count.
    __device__ bool at(const SegmentData& d, int n, int channel, int& value, int& reference) const {
        const int y = first + n / columns * step, x = y % 4 + n % columns * 4;
        if (x >= d.width) return false;
        value = d.image[(static_cast<std::size_t>(y) * d.width + x) * d.channels + channel];
        reference =
            d.reference[(d.cell(y, x / kCellPixels) * d.channels + channel) * kCellPixels + x % kCellPixels];
        return reference >= 24 && reference <= 235 && value < 250;
    }
};

// The inverse of the image's brightness over the reference's, for one channel.
__device__ int inverse_gain(const SegmentData& d, int channel) {
    __shared__ int histogram[kGainBins];
    __shared__ int warp_sums[32];
    __shared__ int median, total, values, references;
    const int n = static_cast<int>(threadIdx.x);
    const GainGrid grid(d);
    histogram[n] = 0;
    if (n == 0) median = total = values = references = 0;
    __syncthreads();
    int value, reference, counted = 0;
    for (int i = n; i < grid.rows * grid.columns; i += kGainThreads) {
        if (!grid.at(d, i, channel, value, reference)) continue;
        ++counted;
        atomicAdd(histogram + min(kGainBins - 1, (value * 256 + reference / 2) / reference), 1);
    }
    if (counted > 0) atomicAdd(&total, counted);
    __syncthreads();
    if (total < 50) return 16384;
    find_median(histogram, warp_sums, &median);
    const float centre = static_cast<float>(median) / 256;
    int own_values = 0, own_references = 0;
    for (int i = n; i < grid.rows * grid.columns; i += kGainThreads) {
        if (!grid.at(d, i, channel, value, reference)) continue;
        const float level = static_cast<float>(reference);
        if (!(fabsf(static_cast<float>(value) - centre * level) < 0.04f * level + 1.0f)) continue;
        own_values += value, own_references += reference;
    }
    if (own_references > 0) atomicAdd(&values, own_values), atomicAdd(&references, own_references);
    __syncthreads();
    if (references == 0) return 16384;
    const float quotient = static_cast<float>(static_cast<double>(values) / references);
    const float gain = fminf(fmaxf(quotient, 0.3f), 3.5f);
    const long inverse = lround(16384.0 / static_cast<double>(gain));
    return static_cast<int>(inverse < 1 ? 1 : inverse > 65535 ? 65535 : inverse);
}

// The gain of a channel by one block each; further blocks clear what the frame fills.
__global__ void __launch_bounds__(kGainThreads) begin_kernel(const SegmentData* __restrict__ cameras) {
    const SegmentData& d = cameras[blockIdx.z];
    const int block = static_cast<int>(blockIdx.x), n = static_cast<int>(threadIdx.x);
    if (!d.look) return;
    if (block < 3) {
        const int inverse = block < d.channels ? inverse_gain(d, block) : 16384;
        if (n == 0) d.state->gain_64[block] = d.scene->inverse_gain[block] = inverse;
        return;
    }
    if (block == 3 && n == 0) {
        CameraState& s = *d.state;
        s.box.y0 = d.height, s.box.y1 = 0, s.box.k0 = d.cells_per_row, s.box.k1 = 0;
        s.vote_box[0] = d.vote_columns(), s.vote_box[1] = d.vote_rows(), s.vote_box[2] = s.vote_box[3] = 0;
        s.noise_factor = 1;
        s.subject_blocks = s.listed = s.near_listed = s.active_listed = s.changed = 0;
    }
    const int blocks = d.vote_columns() * d.vote_rows(), words = d.height * d.cells_per_row;
    for (int i = (block - 3) * kGainThreads + n; i < words; i += kClearingBlocks * kGainThreads)
        d.sharp[i] = d.loose[i] = 0;
    for (int i = (block - 3) * kGainThreads + n; i < d.height; i += kClearingBlocks * kGainThreads)
        d.group_spans[2 * i] = d.cells_per_row * kGroups, d.group_spans[2 * i + 1] = 0;
    for (int i = (block - 3) * kGainThreads + n; i < blocks; i += kClearingBlocks * kGainThreads) {
        d.votes[i] = static_cast<std::int8_t>(-kde::kMaxVote);
        d.changed[i] = 0;
        d.added[i] = 0;
    }
}

// Two neighbouring pixels: a warp works on a cell, a lane on two of its pixels.
struct Pair {
    int low, high;
};
__device__ Pair pair_at(const std::uint8_t* bytes) {
    const unsigned both = *reinterpret_cast<const std::uint16_t*>(bytes);
    return {static_cast<int>(both & 255), static_cast<int>(both >> 8)};
}
__device__ void store_pair(std::uint8_t* bytes, const Pair& pair) {
    *reinterpret_cast<std::uint16_t*>(bytes) = static_cast<std::uint16_t>(pair.low | pair.high << 8);
}

// As DensityTables::squared, but for the last entry, whose kernel is 0 all the same.
__device__ int squared_distance(int value, int sample, int scale) {
    const int index = kde::distance_index(value, sample, scale);
    return index * index + index;
}

// `may_stop`: the sum ends once the cell is plainly background. Returns whether it may hold foreground.
template <int kChannels>
__device__ bool density_of_cell(const SegmentData& d, const kde::DensityTables& tables, std::size_t cell,
                                bool may_stop, Pair& sum) {
    constexpr int kBytes = kChannels * kCellPixels, kLook = kde::kSamplesPerLook;
    const int at = 2 * static_cast<int>(threadIdx.x % 32), sample_count = d.sample_count;
    const std::uint8_t* samples = d.samples + cell * sample_count * kBytes + at;
    Pair value[kChannels], scale[kChannels];
    for (int c = 0; c < kChannels; ++c) {
        value[c] = pair_at(d.values + cell * kBytes + c * kCellPixels + at);
        scale[c] = pair_at(d.scale + cell * kBytes + c * kCellPixels + at);
    }
    sum = {0, 0};
    bool stopped = false;
    for (int first = 0; first < sample_count && !stopped; first += kLook) {
        Pair sample[kLook][kChannels];
#pragma unroll
        for (int i = 0; i < kLook; ++i)  // all loads before the first use
            for (int c = 0; c < kChannels; ++c)
                sample[i][c] = pair_at(samples + min(first + i, sample_count - 1) * kBytes + c * kCellPixels);
#pragma unroll
        for (int i = 0; i < kLook; ++i) {
            if (first + i >= sample_count) break;
            Pair squared{0, 0};
            for (int c = 0; c < kChannels; ++c) {
                squared.low += squared_distance(value[c].low, sample[i][c].low, scale[c].low);
                squared.high += squared_distance(value[c].high, sample[i][c].high, scale[c].high);
            }
            sum.low += kde::kernel_of(tables, squared.low);
            sum.high += kde::kernel_of(tables, squared.high);
        }
        sum = {min(sum.low, 255), min(sum.high, 255)};
        if (!may_stop) continue;
        const int unsure = __popc(__ballot_sync(0xffffffffu, sum.low < kde::kSureDensity)) +
                           __popc(__ballot_sync(0xffffffffu, sum.high < kde::kSureDensity));
        stopped = unsure < kde::kCandidatesPerCell;
    }
    store_pair(d.density + cell * kCellPixels + at, sum);
    return !stopped;
}

// A bit for each slice of four pixels, two lanes, that has one.
__device__ int slices_of(unsigned lanes) {
    unsigned slices = (lanes | lanes >> 1) & 0x55555555u;
    slices = (slices | slices >> 1) & 0x33333333u;
    slices = (slices | slices >> 2) & 0x0f0f0f0fu;
    slices = (slices | slices >> 4) & 0x00ff00ffu;
    return static_cast<int>((slices | slices >> 8) & 0xffffu);
}
static_assert(kActiveMargin == 4);

// Values, density and the cell's flags, by a warp.
template <int kChannels>
__device__ void look_at_cell(const SegmentData& d, const kde::DensityTables& tables, int y, int k) {
    const int lane = static_cast<int>(threadIdx.x % 32), x = k * kCellPixels + 2 * lane;
    const std::size_t cell = d.cell(y, k);
    const std::uint8_t* image = d.image + (static_cast<std::size_t>(y) * d.width + x) * kChannels;
    for (int c = 0; c < kChannels; ++c) {
        const unsigned gain = static_cast<unsigned>(d.state->gain_64[c]);
        const Pair value{x < d.width ? corrected(image[c], gain) : 0,
                         x + 1 < d.width ? corrected(image[kChannels + c], gain) : 0};
        store_pair(d.values + (cell * kChannels + c) * kCellPixels + 2 * lane, value);
    }
    Pair sum;
    const bool candidate = density_of_cell<kChannels>(d, tables, cell, true, sum);
    const unsigned unsure =
        __ballot_sync(0xffffffffu, sum.low < kde::kSureDensity || sum.high < kde::kSureDensity);
    if (lane == 0)
        d.candidates[cell] = static_cast<std::uint8_t>(candidate ? kde::groups_near(slices_of(unsure)) : 0);
}

// A warp a cell of the work.
template <int kChannels>
__global__ void density_kernel(const SegmentData* __restrict__ cameras) {
    __shared__ kde::DensityTables tables;
    const SegmentData& d = cameras[blockIdx.z];
    if (!d.look) return;
    if (threadIdx.x == 0) tables = d.tables;
    __syncthreads();
    const int n = static_cast<int>(blockIdx.x) * kWarps + static_cast<int>(threadIdx.x) / 32;
    if (n >= d.work.rows() * d.work.columns()) return;
    look_at_cell<kChannels>(d, tables, d.work.y0 + n / d.work.columns(), d.work.k0 + n % d.work.columns());
}

// The groups of a cell of the work within kActiveMargin rows and columns of a candidate's unsure pixels.
__device__ int active_groups(const SegmentData& d, int y, int k) {
    int groups = 0;
#pragma unroll
    for (int near = -kActiveMargin; near <= kActiveMargin; ++near) {  // all loads at once
        if (y + near < d.work.y0 || y + near >= d.work.y1) continue;
        const auto unsure_near = [&](int cell) {
            const int faint = d.judge_faint ? d.faint[d.faint_cell(y + near, cell)] : 0;
            return d.candidates[d.cell(y + near, cell)] | kde::groups_near(faint);
        };
        groups |= unsure_near(k) & kde::kAllGroups;
        if (k > d.work.k0 && unsure_near(k - 1) & kde::kNearRight) groups |= 1;
        if (k + 1 < d.work.k1 && unsure_near(k + 1) & kde::kNearLeft) groups |= kde::kLastGroup;
    }
    return groups;
}

// A thread a cell of the image. Lists those that are active, and those that were and are to be neutral again,
// with the groups that were active above kOldGroups.
constexpr int kOldGroups = 27;
__global__ void active_kernel(const SegmentData* __restrict__ cameras) {
    __shared__ int listed, first, box[4];
    const SegmentData& d = cameras[blockIdx.z];
    if (!d.look) return;
    if (threadIdx.x == 0) {
        listed = 0;
        box[0] = d.height, box[1] = 0, box[2] = d.cells_per_row, box[3] = 0;
    }
    __syncthreads();
    const int n = thread_index(), y = n / d.cells_per_row, k = n % d.cells_per_row;
    int before = 0, groups = 0, place = 0;
    if (y < d.height) {
        before = d.active[n];
        if (d.work.holds(y, k)) groups = active_groups(d, y, k);
        d.active[n] = static_cast<std::uint8_t>(groups);
        if (groups | before) place = atomicAdd(&listed, 1);
        if (groups) {
            atomicMin(d.group_spans + 2 * y, k * kGroups + __ffs(groups) - 1);
            atomicMax(d.group_spans + 2 * y + 1, k * kGroups + 32 - __clz(groups));
            atomicMin(box, y);
            atomicMax(box + 1, y + 1);
            atomicMin(box + 2, k);
            atomicMax(box + 3, k + 1);
        }
    }
    __syncthreads();
    CameraState& state = *d.state;
    if (threadIdx.x == 0 && listed > 0) {
        first = atomicAdd(&state.listed, listed);
        if (box[1] > 0) {
            atomicMin(&state.box.y0, box[0]);
            atomicMax(&state.box.y1, box[1]);
            atomicMin(&state.box.k0, box[2]);
            atomicMax(&state.box.k1, box[3]);
        }
    }
    __syncthreads();
    if (groups | before) d.cells[first + place] = n | before << kOldGroups;
}
static_assert(kde::kAllGroups < 1 << (31 - kOldGroups));

// How another light fits a pixel, or neutral values, which the neighbourhoods read, where its group was
// active before and is not now.
template <int kChannels>
__device__ void light_of_pixel(const SegmentData& d, int cell, int groups, int before, int lane) {
    const std::size_t at = d.at(cell / d.cells_per_row, cell % d.cells_per_row * kCellPixels + lane);
    if (!in_group(groups, lane)) {
        if (!in_group(before, lane)) return;
        d.weighted_value[at] = d.weighted_energy[at] = d.product[at] = d.energy[at] = d.square[at] = 0;
        d.evidence[at] = d.voted[at] = -d.parameters.limit;
        return;
    }
    const std::size_t plane = static_cast<std::size_t>(cell) * kChannels * kCellPixels + lane;
    const kde::PixelLight light =
        kde::fit_light<kChannels>(d.values + plane, d.reference + plane, d.scale + plane, d.parameters);
    d.weighted_value[at] = light.weighted_value;
    d.weighted_energy[at] = light.weighted_energy;
    d.factor[at] = light.factor;
    d.residual[at] = light.residual;
    d.product[at] = light.product;
    d.energy[at] = light.energy;
    d.square[at] = light.square;
    d.voted[at] = -d.parameters.limit;
}

// Whether a group of the tile's cells is active, and of those within kSurroundings rows and a cell.
struct Activity {
    bool own = false, around = false;
};
__device__ Activity activity_of(const SegmentData& d, const Tile& tile) {
    int own = 0, around = 0;
#pragma unroll
    for (int dy = -kSurroundings; dy < kTileRows + kSurroundings; ++dy) {
#pragma unroll
        for (int dk = -1; dk <= 1; ++dk) {
            const int y = tile.y0 + dy, k = tile.k + dk,
                      groups = d.work.holds(y, k) ? d.active[d.cell(y, k)] : 0;
            around |= groups;
            if (dk == 0 && dy >= 0 && dy < kTileRows) own |= groups;
        }
    }
    return {own != 0, around != 0};
}

// A thread a tile: lists those that the next steps work on.
__device__ void list_tiles(const SegmentData& d, int n) {
    __shared__ int listed[2], first[2];
    if (threadIdx.x < 2) listed[threadIdx.x] = 0;
    __syncthreads();
    bool near = false, active = false;
    int place[2] = {};
    if (n < d.tiles()) {
        const Tile tile(d, n);
        const Activity activity = activity_of(d, tile);
        const bool in_work = tile.k >= d.work.k0 && tile.k < d.work.k1 && tile.y0 < d.work.y1 &&
                             tile.y0 + kTileRows > d.work.y0;
        near = activity.around || (in_work && d.near[n]);
        if (near) d.near[n] = activity.around, place[0] = atomicAdd(listed, 1);
        active = activity.own;
        if (active) place[1] = atomicAdd(listed + 1, 1);
    }
    __syncthreads();
    if (threadIdx.x == 0) {
        first[0] = atomicAdd(&d.state->near_listed, listed[0]);
        first[1] = atomicAdd(&d.state->active_listed, listed[1]);
    }
    __syncthreads();
    if (near) d.near_tiles[first[0] + place[0]] = n;
    if (active) d.active_tiles[first[1] + place[1]] = n;
}

// A warp a listed cell. Sums that ended early are completed. Blocks from kListBlocks on list tiles.
constexpr int kListBlocks = 256;  // enough to fill the device; they share the list
template <int kChannels>
__global__ void light_kernel(const SegmentData* __restrict__ cameras) {
    __shared__ kde::DensityTables tables;
    const SegmentData& d = cameras[blockIdx.z];
    if (!d.look) return;
    if (blockIdx.x >= kListBlocks)
        return list_tiles(d, static_cast<int>((blockIdx.x - kListBlocks) * blockDim.x + threadIdx.x));
    if (threadIdx.x == 0) tables = d.tables;
    __syncthreads();
    const int listed = d.state->listed, warps = kListBlocks * kWarps;
    for (int n = static_cast<int>(blockIdx.x) * kWarps + static_cast<int>(threadIdx.x) / 32; n < listed;
         n += warps) {
        const int cell = d.cells[n] & ((1 << kOldGroups) - 1), before = d.cells[n] >> kOldGroups;
        const int groups = d.active[cell];
        Pair sum;
        if (groups && !d.candidates[cell])
            density_of_cell<kChannels>(d, tables, static_cast<std::size_t>(cell), false, sum);
        for (int lane = static_cast<int>(threadIdx.x) % 32; lane < kCellPixels; lane += 32)
            light_of_pixel<kChannels>(d, cell, groups, before, lane);
    }
}

// Whether a row, of which word(k) is a cell, has a pixel within kMargin of x.
constexpr int kMargin = 3;
template <class F>
__device__ bool any_near(const SegmentData& d, int x, const F& word) {
    for (int near = max(x - kMargin, 0); near <= min(x + kMargin, d.width - 1); ++near)
        if (word(near / kCellPixels) >> near % kCellPixels & 1) return true;
    return false;
}

// Whether the subject or its margin covers a pixel: it is never learned.
__device__ bool kept_out(const SegmentData& d, int x, int y) {
    const CellRange& box = d.state->box;
    for (int dy = -kMargin; dy <= kMargin; dy += kMargin) {
        const int row = min(max(y + dy, 0), d.height - 1);
        const auto loose = [&](int k) { return box.holds(row, k) ? d.loose[d.cell(row, k)] : Word{0}; };
        const auto expected = [&](int k) { return d.expected.at(row, k); };
        if (any_near(d, x, loose) || (d.expected.words && any_near(d, x, expected))) return true;
    }
    return false;
}

template <int kChannels>
__device__ void update_pixel(const SegmentData& d, std::size_t cell, int x, int y) {
    const int lane = x % kCellPixels;
    const std::size_t plane = cell * kChannels * kCellPixels + lane;
    const kde::PixelModel pixel{d.samples + cell * d.sample_count * kChannels * kCellPixels + lane,
                                d.scale + plane, d.reference + plane, d.candidate + plane,
                                d.visits + cell * kCellPixels + lane};
    const bool background = d.density[cell * kCellPixels + lane] >= kde::kLearnDensity;
    const bool free = !(d.tracked && kept_out(d, x, y));
    if (background || !free) *pixel.visits = 0;
    if (!free) return;
    if (!background) {
        kde::watch_strange_value(d.values + plane, kChannels, d.update, pixel);
        return;
    }
    kde::learn_background_value(d.values + plane, kChannels, d.update, pixel);
    d.log_peak[cell * kCellPixels + lane] = kde::log_peak_of(d.log_scale, pixel.scale, kChannels);
}

// A warp a cell of the rows that are due; where the work did not go, it looks at the cell first.
template <int kChannels>
__global__ void update_kernel(const SegmentData* __restrict__ cameras) {
    __shared__ kde::DensityTables tables;
    const SegmentData& d = cameras[blockIdx.z];
    if (d.interval == 0) return;
    if (threadIdx.x == 0) tables = d.tables;
    __syncthreads();
    const int n = static_cast<int>(blockIdx.x) * kWarps + static_cast<int>(threadIdx.x) / 32;
    const int y = d.phase + n / d.cells_per_row * d.interval, k = n % d.cells_per_row;
    if (y >= d.height) return;
    if (!d.work.holds(y, k)) look_at_cell<kChannels>(d, tables, y, k);
    const int x = k * kCellPixels + 2 * (static_cast<int>(threadIdx.x) % 32);  // as there
    if (x < d.width) update_pixel<kChannels>(d, d.cell(y, k), x, y);
    if (x + 1 < d.width) update_pixel<kChannels>(d, d.cell(y, k), x + 1, y);
}

__global__ void fill_kernel(float* plane, float value, std::size_t count) {
    const auto n = static_cast<std::size_t>(thread_index());
    if (n < count) plane[n] = value;
}

dim3 blocks_of_warps(unsigned warps, int count) {
    return dim3((warps + kWarps - 1) / kWarps, 1, static_cast<unsigned>(count));
}

}  // namespace

void queue_fill(const Stream& stream, float* plane, float value, std::size_t count) {
    fill_kernel<<<blocks(count), kThreads, 0, stream.get()>>>(plane, value, count);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_density(const Stream& stream, const FrameSet& cameras) {
    const int count = static_cast<int>(cameras.host.size());
    const auto z = static_cast<unsigned>(count);
    begin_kernel<<<dim3(3 + kClearingBlocks, 1, z), kGainThreads, 0, stream.get()>>>(cameras.device);
    const dim3 work = blocks_of_warps(
        max_of(cameras, count, [](const SegmentData& d) { return d.work.rows() * d.work.columns(); }), count);
    if (cameras.channels == 1) {
        density_kernel<1><<<work, kThreads, 0, stream.get()>>>(cameras.device);
    } else {
        density_kernel<3><<<work, kThreads, 0, stream.get()>>>(cameras.device);
    }
    queue_faint_blocks(stream, cameras);
    const unsigned cells =
        max_of(cameras, count, [](const SegmentData& d) { return d.height * d.cells_per_row; });
    active_kernel<<<dim3((cells + kThreads - 1) / kThreads, 1, z), kThreads, 0, stream.get()>>>(
        cameras.device);
    const unsigned tiles = max_of(cameras, count, [](const SegmentData& d) { return d.tiles(); });
    const dim3 lists(kListBlocks + (tiles + kThreads - 1) / kThreads, 1, z);
    if (cameras.channels == 1) {
        light_kernel<1><<<lists, kThreads, 0, stream.get()>>>(cameras.device);
    } else {
        light_kernel<3><<<lists, kThreads, 0, stream.get()>>>(cameras.device);
    }
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_update(const Stream& stream, const FrameSet& cameras, int count) {
    const unsigned cells = max_of(cameras, count, [](const SegmentData& d) {
        return d.interval == 0 ? 0 : (d.height - d.phase + d.interval - 1) / d.interval * d.cells_per_row;
    });
    const dim3 due = blocks_of_warps(cells, count);
    if (cameras.channels == 1) {
        update_kernel<1><<<due, kThreads, 0, stream.get()>>>(cameras.device);
    } else {
        update_kernel<3><<<due, kThreads, 0, stream.get()>>>(cameras.device);
    }
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
