#include <algorithm>

#include "kernels/cuda/segmentation_steps.h"
#include "kernels/shared/kde_evidence.h"

namespace kinevox::kernels::cuda {
namespace {

using kde::kActiveMargin;
using kde::kCellPixels;

// As split_cell() of the CPU form: gain, rounding, and white that stays white.
__device__ std::uint8_t corrected(unsigned value, unsigned gain_64) {
    const unsigned scaled = (((value * gain_64) >> 8) + 32) >> 6;
    return static_cast<std::uint8_t>(value >= 253 ? 255 : scaled < 255 ? scaled : 255);
}

// All 64 threads of the block come here with the same cell. True: the cell may hold foreground.
__device__ bool density_of_cell(const SegmentData& d, const kde::DensityTables& tables, std::size_t cell,
                                bool may_stop) {
    const int lane = threadIdx.x, bytes = d.channels * kCellPixels;
    const std::uint8_t* samples = d.samples + cell * d.sample_count * bytes + lane;
    int sum = 0;
    bool stopped = false;
    for (int first = 0; first < d.sample_count && !stopped; first += kde::kSamplesPerLook) {
        const int count = min(kde::kSamplesPerLook, d.sample_count - first);
        sum += kde::density(tables, d.values + cell * bytes + lane, samples + first * bytes,
                            d.scale + cell * bytes + lane, count, d.channels);
        sum = min(sum, 255);
        const int unsure = __syncthreads_count(sum < kde::kSureDensity);
        stopped = may_stop && unsure < kde::kCandidatesPerCell;
    }
    d.density[cell * kCellPixels + lane] = static_cast<std::uint8_t>(sum);
    return !stopped;
}

// Values, density and the cell's flags.
__device__ void look_at_cell(const SegmentData& d, int y, int k) {
    __shared__ kde::DensityTables tables;
    const int lane = threadIdx.x, x = k * kCellPixels + lane;
    const std::size_t cell = d.cell(y, k);
    if (lane == 0) tables = d.tables;
    for (int c = 0; c < d.channels; ++c) {
        std::uint8_t value = 0;
        if (x < d.width) {
            value = corrected(d.image[(static_cast<std::size_t>(y) * d.width + x) * d.channels + c],
                              static_cast<unsigned>(d.gain_64[c]));
        }
        d.values[(cell * d.channels + c) * kCellPixels + lane] = value;
    }
    __syncthreads();
    const bool candidate = density_of_cell(d, tables, cell, true);
    const bool unsure = d.density[cell * kCellPixels + lane] < kde::kSureDensity;
    __shared__ int slices;
    if (lane == 0) slices = 0;
    __syncthreads();
    if (unsure) atomicOr(&slices, 1 << lane / kActiveMargin);
    __syncthreads();
    if (lane == 0) d.candidates[cell] = static_cast<std::uint8_t>(candidate ? kde::groups_near(slices) : 0);
}

__global__ void density_kernel(SegmentData d, CellRange work) {
    look_at_cell(d, work.y0 + static_cast<int>(blockIdx.y), work.k0 + static_cast<int>(blockIdx.x));
}

__global__ void row_density_kernel(SegmentData d, CellRange work, int phase, int interval) {
    const int y = phase + static_cast<int>(blockIdx.y) * interval, k = blockIdx.x;
    if (y >= work.y0 && y < work.y1 && k >= work.k0 && k < work.k1) return;
    look_at_cell(d, y, k);
}

// Whether a cell's pixel belongs to one of the groups.
__device__ bool in_group(int groups, int lane) {
    return groups >> lane / kde::kGroupPixels & 1;
}

// A thread a cell of `work`: its groups within kActiveMargin rows and columns of a candidate's unsure pixels.
__global__ void active_kernel(SegmentData d, CellRange work) {
    const int n = thread_index(), columns = work.k1 - work.k0;
    const int y = work.y0 + n / columns, k = work.k0 + n % columns;
    if (y >= work.y1) return;
    int groups = 0;
    for (int near = max(y - kActiveMargin, work.y0); near <= min(y + kActiveMargin, work.y1 - 1); ++near) {
        groups |= d.candidates[d.cell(near, k)] & kde::kAllGroups;
        if (k > work.k0 && d.candidates[d.cell(near, k - 1)] & kde::kNearRight) groups |= 1;
        if (k + 1 < work.k1 && d.candidates[d.cell(near, k + 1)] & kde::kNearLeft) groups |= kde::kLastGroup;
    }
    d.active[d.cell(y, k)] = static_cast<std::uint8_t>(groups);
    if (groups == 0) return;
    atomicMin(d.active_box, y);
    atomicMax(d.active_box + 1, y + 1);
    atomicMin(d.active_box + 2, k);
    atomicMax(d.active_box + 3, k + 1);
}

// One block a cell of the box and of a ring around it, which the neighbourhoods read and which holds neutral
// values.
template <int kChannels>
__global__ void light_kernel(SegmentData d, CellRange box) {
    __shared__ kde::DensityTables tables;
    const int y = box.y0 - kde::kNeutralMargin + static_cast<int>(blockIdx.y);
    const int k = box.k0 - 1 + static_cast<int>(blockIdx.x), lane = threadIdx.x;
    const std::size_t at = d.at(y, k * kCellPixels + lane);
    const bool inside = y >= box.y0 && y < box.y1 && k >= box.k0 && k < box.k1;
    const auto neutral = [&] {
        d.weighted_value[at] = d.weighted_energy[at] = d.product[at] = d.energy[at] = d.square[at] = 0;
        d.evidence[at] = -d.parameters.limit;
    };
    if (!inside || !d.active[d.cell(y, k)]) return neutral();
    const std::size_t cell = d.cell(y, k), plane = cell * kChannels * kCellPixels + lane;
    if (lane == 0) tables = d.tables;
    __syncthreads();
    if (!d.candidates[cell]) density_of_cell(d, tables, cell, false);  // its sums ended early
    if (!in_group(d.active[cell], lane)) return neutral();
    const kde::PixelLight light =
        kde::fit_light<kChannels>(d.values + plane, d.reference + plane, d.scale + plane, d.parameters);
    d.weighted_value[at] = light.weighted_value;
    d.weighted_energy[at] = light.weighted_energy;
    d.factor[at] = light.factor;
    d.residual[at] = light.residual;
    d.product[at] = light.product;
    d.energy[at] = light.energy;
    d.square[at] = light.square;
}

// As far around the box as its pixels look; each look sees as far again.
constexpr int kSurroundings = std::max(kde::kLightRadius, kde::kPatchRadius);
static_assert(2 * kSurroundings <= kde::kNeutralMargin);

// The light of the window around each pixel of the box and its surroundings, and the misfit of one light to
// its patch; summed in the CPU form's order.
__global__ void surroundings_kernel(SegmentData d, CellRange box) {
    const int y = box.y0 - kSurroundings + static_cast<int>(blockIdx.y);
    const int x = (box.k0 - 1 + static_cast<int>(blockIdx.x)) * kCellPixels + static_cast<int>(threadIdx.x);
    if (x < box.k0 * kCellPixels - kSurroundings || x >= box.k1 * kCellPixels + kSurroundings) return;
    const auto sum = [&](const float* plane, int radius) {
        float total = 0;
        for (int dx = -radius; dx <= radius; ++dx) {
            float column = plane[d.at(y - radius, x + dx)];
            for (int dy = -radius + 1; dy <= radius; ++dy) column += plane[d.at(y + dy, x + dx)];
            total += column;
        }
        return total;
    };
    const float value = sum(d.weighted_value, kde::kLightRadius),
                light = sum(d.weighted_energy, kde::kLightRadius);
    const float product = sum(d.product, kde::kPatchRadius), energy = sum(d.energy, kde::kPatchRadius);
    const float left =
        (sum(d.square, kde::kPatchRadius) - product * product / (energy > 1e-6f ? energy : 1e-6f)) *
        (1.0f / static_cast<float>(49 * d.channels));
    d.neighbourhood[d.at(y, x)] = light > 0 ? value / light : 1.0f;
    d.misfit[d.at(y, x)] = left > 0 ? left : 0;
}

template <int kChannels>
__global__ void evidence_kernel(SegmentData d, CellRange box) {
    constexpr int kRadius = kde::kLightRadius;
    const int y = box.y0 + static_cast<int>(blockIdx.y), k = box.k0 + static_cast<int>(blockIdx.x),
              lane = threadIdx.x;
    const std::size_t cell = d.cell(y, k), at = d.at(y, k * kCellPixels + lane);
    if (!in_group(d.active[cell], lane)) return;
    const auto step_to = [&](int ox, int oy) {
        return fabsf(d.factor[at] - d.neighbourhood[d.at(y + oy, k * kCellPixels + lane + ox)]);
    };
    float step = step_to(0, -kRadius);
    step = fminf(step, step_to(-kRadius, 0));
    step = fminf(step, step_to(0, 0));
    step = fminf(step, step_to(kRadius, 0));
    step = fminf(step, step_to(0, kRadius));
    const std::size_t plane = cell * kChannels * kCellPixels + lane;
    const std::uint8_t density = d.density[cell * kCellPixels + lane];
    d.evidence[at] = kde::evidence<kChannels>(
        d.values + plane, d.reference + plane, d.scale + plane, density, d.log_lit[density],
        d.log_peak[cell * kCellPixels + lane], d.residual[at], step,
        d.log_foreground[kde::histogram_bin<kChannels>(d.values + plane)], d.parameters);
}

// A thread a block of the whole image.
__global__ void vote_kernel(SegmentData d, CellRange box) {
    constexpr int kBlock = kde::kVoteBlock_px;
    const int n = thread_index(), row = n / d.vote_columns(), column = n % d.vote_columns();
    if (row >= d.vote_rows()) return;
    int vote = -kde::kMaxVote;
    for (int y = max(row * kBlock, box.y0); y < min((row + 1) * kBlock, box.y1); ++y)
        for (int x = column * kBlock; x < min((column + 1) * kBlock, d.width); ++x) {
            const int k = x / kCellPixels, lane = x - k * kCellPixels;
            if (k < box.k0 || k >= box.k1 || !in_group(d.active[d.cell(y, k)], lane)) continue;
            vote += 1 + kde::pixel_vote(d.density[d.cell(y, k) * kCellPixels + lane], d.evidence[d.at(y, x)]);
        }
    d.votes[n] = static_cast<std::int8_t>(vote);
    if (vote < kde::kSubjectVote) return;
    atomicMin(d.vote_box, column);
    atomicMin(d.vote_box + 1, row);
    atomicMax(d.vote_box + 2, column + 1);
    atomicMax(d.vote_box + 3, row + 1);
    atomicAdd(d.vote_box + 4, 1);
}

// A thread a block of the whole image.
__global__ void support_kernel(SegmentData d, CellRange box, FloorScenes floor) {
    constexpr int kBlock = kde::kSupportBlock_px;
    const int n = thread_index(), row = n / d.support_columns(), column = n % d.support_columns();
    if (row >= d.support_rows() || (row + 1) * kBlock <= box.y0 || row * kBlock >= box.y1 ||
        (column + 1) * kBlock <= box.k0 * kCellPixels || column * kBlock >= box.k1 * kCellPixels)
        return;
    kde::SupportRay ray;
    const bool known = kde::support_ray(floor.grid, floor.camera, kde::block_centre<kBlock>(column * kBlock),
                                        kde::block_centre<kBlock>(row * kBlock), ray);
    d.support[n] = known ? kde::support_of(ray, floor.count,
                                           [&](int i) -> const kde::SceneView& { return floor.others[i]; })
                         : kde::kUnknownSupport;
}

template <int kChannels>
__global__ void shadow_kernel(SegmentData d, CellRange box, FloorScenes floor) {
    const int y = box.y0 + static_cast<int>(blockIdx.y), k = box.k0 + static_cast<int>(blockIdx.x),
              lane = threadIdx.x, x = k * kCellPixels + lane;
    const std::size_t cell = d.cell(y, k), at = d.at(y, x);
    d.voted[at] = -d.parameters.limit;
    if (x >= d.width || !in_group(d.active[cell], lane)) return;
    if (d.density[cell * kCellPixels + lane] >= kde::kSureDensity || d.evidence[at] >= kde::kDoubtfulEvidence)
        return;
    const int block = y / kde::kVoteBlock_px * d.vote_columns() + x / kde::kVoteBlock_px;
    if (d.votes[block] < kde::kMinJudgedVote) return;
    const float support =
        d.support[y / kde::kSupportBlock_px * d.support_columns() + x / kde::kSupportBlock_px];
    if (support < kde::kMinSupport && !kde::is_lighter(d.factor + at, d.stride())) {
        d.evidence[at] = -d.parameters.limit;
        return;
    }
    const std::size_t plane = cell * kChannels * kCellPixels + lane;
    const float distance =
        kde::squared_distance<kChannels>(d.values + plane, d.reference + plane, d.scale + plane);
    auto e = kde::own_evidence<kChannels, float>(
        distance, d.log_foreground[kde::histogram_bin<kChannels>(d.values + plane)],
        {d.factor + at, d.residual + at, d.neighbourhood + at, d.misfit + at, d.stride()});
    float floor_x, floor_y;
    if (floor.count > 0 &&
        kde::floor_point(floor.grid, floor.camera, kde::block_centre<kde::kFloorBlock_px>(x),
                         kde::block_centre<kde::kFloorBlock_px>(y), floor_x, floor_y))
        for (int n = 0; n < floor.count; ++n)
            kde::add_floor_light(
                e, kde::light_of_floor<kChannels>(floor.others[n], floor_x, floor_y, d.parameters));
    e.support = support;
    const auto odds = kde::shadow_log_odds(e, d.parameters.shadow);
    d.evidence[at] = odds.own;
    d.voted[at] = odds.voted;
    if (odds.changed()) atomicAdd(d.changed + block, 1);
}

// A thread a block of the whole image: marks the square around it if the votes change enough of its pixels.
__global__ void limb_kernel(SegmentData d) {
    const int n = thread_index(), columns = d.vote_columns(), rows = d.vote_rows();
    const int row = n / columns, column = n % columns;
    if (row >= rows) return;
    const int radius = kde::voted_radius(d.vote_box[4]);
    const int x0 = max(column - radius, 0), x1 = min(column + radius + 1, columns), y0 = max(row - radius, 0),
              y1 = min(row + radius + 1, rows);
    int changed = 0;
    for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x) changed += d.changed[y * columns + x];
    if (!kde::is_limb(changed, radius)) return;
    for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x) d.added[y * columns + x] = 1;
}

__global__ void added_kernel(SegmentData d, CellRange box) {
    const int y = box.y0 + static_cast<int>(blockIdx.y);
    const int x = (box.k0 + static_cast<int>(blockIdx.x)) * kCellPixels + static_cast<int>(threadIdx.x);
    if (x >= d.width || !d.added[y / kde::kVoteBlock_px * d.vote_columns() + x / kde::kVoteBlock_px]) return;
    d.evidence[d.at(y, x)] = fmaxf(d.evidence[d.at(y, x)], d.voted[d.at(y, x)]);
}

__global__ void smooth_kernel(SegmentData d, CellRange box, Smoothing w) {
    const int y = box.y0 + static_cast<int>(blockIdx.y);
    const int x = (box.k0 + static_cast<int>(blockIdx.x)) * kCellPixels + static_cast<int>(threadIdx.x);
    float across[5];
    for (int n = 0; n < 5; ++n) {
        const float* e = d.evidence + d.at(y, x + n - 2);
        const std::ptrdiff_t row = d.stride();
        across[n] = w.w0 * (e[-2 * row] + e[2 * row]) + w.w1 * (e[-row] + e[row]) + w.w2 * e[0];
    }
    d.smoothed[d.at(y, x)] =
        w.w0 * (across[0] + across[4]) + w.w1 * (across[1] + across[3]) + w.w2 * across[2];
}

__device__ bool pixel_of(const Rect& box, int n, int& x, int& y) {
    const int columns = box.x1 - box.x0;
    x = box.x0 + n % columns, y = box.y0 + n / columns;
    return y < box.y1;
}

__global__ void decide_kernel(SegmentData d, Rect box, float sharp, float loose) {
    int x, y;
    if (!pixel_of(box, thread_index(), x, y)) return;
    const float evidence = d.smoothed[d.at(y, x)];
    const std::size_t at = static_cast<std::size_t>(y) * d.width + x;
    const int step = static_cast<int>(evidence * (127.5f / d.parameters.limit) + 127.5f);
    d.probability[at] = d.probability_of[min(max(step, 0), 255)];
    d.loose[at] = evidence > loose ? 255 : 0;
    d.sharp[at] = evidence > sharp ? 255 : 0;
}

template <int kChannels>
__global__ void colour_kernel(SegmentData d, Rect box, float sure_evidence) {
    constexpr int kDepth = 2;
    int x, y;
    if (!pixel_of(box, thread_index(), x, y)) return;
    if (x < kDepth || y < kDepth || x >= d.width - kDepth || y >= d.height - kDepth) return;
    const std::uint8_t* here = d.sharp + static_cast<std::size_t>(y) * d.width + x;
    const std::ptrdiff_t rows = static_cast<std::ptrdiff_t>(kDepth) * d.width;
    if (!(*here && here[-kDepth] && here[kDepth] && here[-rows] && here[rows])) return;
    if (d.smoothed[d.at(y, x)] < sure_evidence) return;
    const std::uint8_t* value =
        d.values + d.cell(y, x / kCellPixels) * kChannels * kCellPixels + x % kCellPixels;
    atomicAdd(d.colour_counts + kde::histogram_bin<kChannels>(value), 1);
}

template <int kChannels>
__global__ void border_kernel(SegmentData d, Rect box, Rect limit, kde::BorderParameters parameters) {
    int x, y;
    if (!pixel_of(box, thread_index(), x, y)) return;
    const std::size_t at = static_cast<std::size_t>(y) * d.width + x;
    if (d.zones[at] != kde::kZoneBorder) return;
    const int part = kde::unmix_border_pixel<kChannels>(x, y, d.width, limit, d.zones, d.values, d.reference,
                                                        d.cells_per_row, parameters);
    if (part >= 0) d.sharp[at] = part ? 255 : 0;
}

__global__ void measure_kernel(SegmentData d, Rect box) {
    __shared__ unsigned long long sums[3];
    __shared__ int bounds[4];
    if (threadIdx.x == 0) {
        sums[0] = sums[1] = sums[2] = 0;
        bounds[0] = d.width, bounds[1] = d.height, bounds[2] = bounds[3] = 0;
    }
    __syncthreads();
    int x, y;
    if (pixel_of(box, thread_index(), x, y)) {
        const std::size_t at = static_cast<std::size_t>(y) * d.width + x;
        const bool sharp = d.sharp[at] != 0;
        if (sharp) {
            d.loose[at] = 255;
            atomicAdd(sums, 1ull);
            atomicAdd(sums + 1, static_cast<unsigned long long>(x));
            atomicAdd(sums + 2, static_cast<unsigned long long>(y));
        }
        if (sharp || d.loose[at]) {
            atomicMin(bounds, x);
            atomicMin(bounds + 1, y);
            atomicMax(bounds + 2, x + 1);
            atomicMax(bounds + 3, y + 1);
        }
    }
    __syncthreads();
    if (threadIdx.x != 0 || bounds[2] == 0) return;
    for (int n = 0; n < 3; ++n) atomicAdd(d.sums + n, sums[n]);
    for (int n = 0; n < 2; ++n) atomicMin(d.bounds + n, bounds[n]);
    for (int n = 2; n < 4; ++n) atomicMax(d.bounds + n, bounds[n]);
}

// Whether the subject or its margin covers a pixel: it is never learned.
__device__ bool kept_out(const SegmentData& d, int x, int y) {
    constexpr int kMargin = 3;
    for (int dy = -kMargin; dy <= kMargin; dy += kMargin) {
        const std::size_t row = static_cast<std::size_t>(min(max(y + dy, 0), d.height - 1)) * d.width;
        for (int near = max(x - kMargin, 0); near <= min(x + kMargin, d.width - 1); ++near) {
            if (d.loose[row + near] || (d.expected && d.expected[row + near])) return true;
        }
    }
    return false;
}

// One block a cell of the rows that are due.
__global__ void update_kernel(SegmentData d, kde::UpdateParameters p, int phase, int interval, bool tracked) {
    const int y = phase + static_cast<int>(blockIdx.y) * interval, k = blockIdx.x, lane = threadIdx.x;
    const int x = k * kCellPixels + lane;
    if (x >= d.width) return;
    const std::size_t cell = d.cell(y, k), plane = cell * d.channels * kCellPixels + lane;
    const kde::PixelModel pixel{d.samples + cell * d.sample_count * d.channels * kCellPixels + lane,
                                d.scale + plane, d.reference + plane, d.candidate + plane,
                                d.visits + cell * kCellPixels + lane};
    const bool background = d.density[cell * kCellPixels + lane] >= kde::kLearnDensity;
    const bool free = !(tracked && kept_out(d, x, y));
    if (background || !free) *pixel.visits = 0;
    if (!free) return;
    if (!background) {
        kde::watch_strange_value(d.values + plane, d.channels, p, pixel);
        return;
    }
    kde::learn_background_value(d.values + plane, d.channels, p, pixel);
    d.log_peak[cell * kCellPixels + lane] = kde::log_peak_of(d.log_scale, pixel.scale, d.channels);
}

dim3 cells_of(const CellRange& range) {
    return dim3(static_cast<unsigned>(range.k1 - range.k0), static_cast<unsigned>(range.y1 - range.y0));
}

std::size_t pixels_of(const Rect& box) {
    return static_cast<std::size_t>(box.width()) * box.height();
}

unsigned rows_due(int height, int phase, int interval) {
    return static_cast<unsigned>(std::max(0, (height - phase + interval - 1) / interval));
}

}  // namespace

void queue_density(const Stream& stream, const SegmentData& data, const CellRange& work) {
    if (work.empty()) return;
    density_kernel<<<cells_of(work), kCellPixels, 0, stream.get()>>>(data, work);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_density_of_rows(const Stream& stream, const SegmentData& data, const CellRange& work, int phase,
                           int interval) {
    const unsigned rows = rows_due(data.height, phase, interval);
    if (rows == 0) return;
    const dim3 grid(static_cast<unsigned>(data.cells_per_row), rows);
    row_density_kernel<<<grid, kCellPixels, 0, stream.get()>>>(data, work, phase, interval);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_active(const Stream& stream, const SegmentData& data, const CellRange& work) {
    if (work.empty()) return;
    const std::size_t cells = static_cast<std::size_t>(work.y1 - work.y0) * (work.k1 - work.k0);
    active_kernel<<<blocks(cells), kThreads, 0, stream.get()>>>(data, work);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_evidence(const Stream& stream, const SegmentData& data, const CellRange& box) {
    const auto ring = [&](int rows) {
        return cells_of({box.y0 - rows, box.y1 + rows, box.k0 - 1, box.k1 + 1});
    };
    const dim3 neutral = ring(kde::kNeutralMargin);
    if (data.channels == 1) {
        light_kernel<1><<<neutral, kCellPixels, 0, stream.get()>>>(data, box);
    } else {
        light_kernel<3><<<neutral, kCellPixels, 0, stream.get()>>>(data, box);
    }
    surroundings_kernel<<<ring(kSurroundings), kCellPixels, 0, stream.get()>>>(data, box);
    if (data.channels == 1) {
        evidence_kernel<1><<<cells_of(box), kCellPixels, 0, stream.get()>>>(data, box);
    } else {
        evidence_kernel<3><<<cells_of(box), kCellPixels, 0, stream.get()>>>(data, box);
    }
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_votes(const Stream& stream, const SegmentData& data, const CellRange& box) {
    const std::size_t votes = static_cast<std::size_t>(data.vote_columns()) * data.vote_rows();
    vote_kernel<<<blocks(votes), kThreads, 0, stream.get()>>>(data, box);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_shadows(const Stream& stream, const SegmentData& data, const CellRange& box,
                   const FloorScenes& floor) {
    const std::size_t supports = static_cast<std::size_t>(data.support_columns()) * data.support_rows();
    support_kernel<<<blocks(supports), kThreads, 0, stream.get()>>>(data, box, floor);
    if (data.channels == 1) {
        shadow_kernel<1><<<cells_of(box), kCellPixels, 0, stream.get()>>>(data, box, floor);
    } else {
        shadow_kernel<3><<<cells_of(box), kCellPixels, 0, stream.get()>>>(data, box, floor);
    }
    const std::size_t votes = static_cast<std::size_t>(data.vote_columns()) * data.vote_rows();
    limb_kernel<<<blocks(votes), kThreads, 0, stream.get()>>>(data);
    added_kernel<<<cells_of(box), kCellPixels, 0, stream.get()>>>(data, box);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_smoothing(const Stream& stream, const SegmentData& data, const CellRange& box,
                     const Smoothing& smoothing) {
    smooth_kernel<<<cells_of(box), kCellPixels, 0, stream.get()>>>(data, box, smoothing);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_decisions(const Stream& stream, const SegmentData& data, const Rect& box, float sharp,
                     float loose) {
    decide_kernel<<<blocks(pixels_of(box)), kThreads, 0, stream.get()>>>(data, box, sharp, loose);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_colour_counts(const Stream& stream, const SegmentData& data, const Rect& box,
                         float sure_evidence) {
    if (data.channels == 1) {
        colour_kernel<1><<<blocks(pixels_of(box)), kThreads, 0, stream.get()>>>(data, box, sure_evidence);
    } else {
        colour_kernel<3><<<blocks(pixels_of(box)), kThreads, 0, stream.get()>>>(data, box, sure_evidence);
    }
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_border(const Stream& stream, const SegmentData& data, const Rect& box, const Rect& limit) {
    const kde::BorderParameters parameters;
    if (data.channels == 1) {
        border_kernel<1><<<blocks(pixels_of(box)), kThreads, 0, stream.get()>>>(data, box, limit, parameters);
    } else {
        border_kernel<3><<<blocks(pixels_of(box)), kThreads, 0, stream.get()>>>(data, box, limit, parameters);
    }
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_measure(const Stream& stream, const SegmentData& data, const Rect& box) {
    measure_kernel<<<blocks(pixels_of(box)), kThreads, 0, stream.get()>>>(data, box);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_update(const Stream& stream, const SegmentData& data, const kde::UpdateParameters& parameters,
                  int phase, int interval, bool tracked) {
    const unsigned rows = rows_due(data.height, phase, interval);
    if (rows == 0) return;
    const dim3 grid(static_cast<unsigned>(data.cells_per_row), rows);
    update_kernel<<<grid, kCellPixels, 0, stream.get()>>>(data, parameters, phase, interval, tracked);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
