// What each camera sees of a volume: its depth images on a grid of cells, and the colours and the silhouette
// on that grid. See kernels/cpu/visibility.h for the ideas.
#include "kernels/cuda/bricks.cuh"
#include "kernels/cuda/volume.h"

namespace kinevox::kernels::cuda {
namespace {

constexpr double kDepthUnit = 1 << 20;  // depths are summed as whole numbers, so that their order never shows
constexpr int kFrameThreads = 1024;

// What the bricks give of a view, see frame_brick().
struct Covered {
    int box[4];  // x0 y0 x1 y1, px
    unsigned long long depth;
    int bricks;
};

// As finish_frame(); where the cells have no room, none is looked at.
__device__ void finish_view(const Covered& covered, const Projector& camera, float voxel_m, int room,
                            VolumeState& state, ViewState& view) {
    const double depth_m = static_cast<double>(covered.depth) / kDepthUnit;
    const float focal = camera.fx > camera.fy ? camera.fx : camera.fy;
    view.shift =
        cell_shift(covered.bricks > 0 ? focal * voxel_m / static_cast<float>(depth_m / covered.bricks) : 1.f);
    const int x0 = max(covered.box[0], 0), y0 = max(covered.box[1], 0),
              x1 = min(covered.box[2], camera.width), y1 = min(covered.box[3], camera.height);
    view.cells = {};
    if (x1 > x0 && y1 > y0)
        view.cells = {x0 >> view.shift, y0 >> view.shift, ((x1 - 1) >> view.shift) + 1,
                      ((y1 - 1) >> view.shift) + 1};
    const int cells = (view.cells.x1 - view.cells.x0) * (view.cells.y1 - view.cells.y0);
    atomicMax(&state.needed.cells, cells);
    if (cells > room) view.cells = {};
    view.width = view.cells.x1 - view.cells.x0;
    view.height = view.cells.y1 - view.cells.y0;
}

// One block a view.
__global__ void __launch_bounds__(kFrameThreads) frame_views(const VolumeJob* __restrict__ job, int now) {
    __shared__ Covered covered;
    const Lattice& lattice = job->lattice;
    const Projector& camera = job->views[blockIdx.x].camera;
    if (threadIdx.x == 0) {
        covered.box[0] = camera.width, covered.box[1] = camera.height;
        covered.box[2] = covered.box[3] = covered.bricks = 0;
        covered.depth = 0;
    }
    __syncthreads();
    const float edge = kBrickEdge * lattice.voxel_m;
    Rect px{camera.width, camera.height, 0, 0};
    unsigned long long depth = 0;
    int seen = 0;
    const int bricks = job->state->bricks;
    for (int n = static_cast<int>(threadIdx.x); n < bricks; n += kFrameThreads) {
        const BrickPosition brick = job->positions[n];
        std::uint64_t any = 0;
        for (int k = 0; k < kBrickEdge; ++k)
            any |= job->occupancy[now][static_cast<std::size_t>(n) * kBrickEdge + k];
        if (any == 0) continue;
        float depth_m;
        if (!frame_brick(camera, lattice.origin[0] + (brick.x + 0.5f) * edge,
                         lattice.origin[1] + (brick.y + 0.5f) * edge,
                         lattice.origin[2] + (brick.z + 0.5f) * edge, edge, px, depth_m))
            continue;
        depth += static_cast<unsigned long long>(static_cast<double>(depth_m) * kDepthUnit);
        ++seen;
    }
    atomicMin(covered.box, px.x0), atomicMin(covered.box + 1, px.y0);
    atomicMax(covered.box + 2, px.x1), atomicMax(covered.box + 3, px.y1);
    if (seen > 0) atomicAdd(&covered.depth, depth), atomicAdd(&covered.bricks, seen);
    __syncthreads();
    if (threadIdx.x == 0)
        finish_view(covered, camera, lattice.voxel_m, job->room.cells, *job->state,
                    job->view_states[blockIdx.x]);
}

// Mean colour of each cell and of a rim of one; beyond the image the rim repeats its border.
__global__ void cell_means(const VolumeJob* __restrict__ job) {
    const VolumeView& view = job->views[blockIdx.y];
    const ViewState& state = job->view_states[blockIdx.y];
    if (!view.image || state.width == 0) return;
    const int columns = state.width + 2, count = columns * (state.height + 2), width = view.camera.width;
    const int last_column = (width - 1) >> state.shift, last_row = (view.camera.height - 1) >> state.shift;
    for (int n = thread_index(); n < count; n += thread_count()) {
        const int column = min(max(state.cells.x0 + n % columns - 1, 0), last_column);
        const int row = min(max(state.cells.y0 + n / columns - 1, 0), last_row);
        const int x0 = column << state.shift, x1 = min(x0 + (1 << state.shift), width);
        const int y0 = row << state.shift, y1 = min(y0 + (1 << state.shift), view.camera.height);
        unsigned sum[3] = {};
        for (int y = y0; y < y1; ++y) {
            for (int x = x0; x < x1; ++x) {
                const std::uint8_t* pixel =
                    view.image + (static_cast<std::size_t>(y) * width + x) * view.channels;
                for (int c = 0; c < 3; ++c) sum[c] += pixel[view.channels == 3 ? c : 0];
            }
        }
        const unsigned pixels = static_cast<unsigned>((x1 - x0) * (y1 - y0));
        for (int c = 0; c < 3; ++c)
            view.means[3 * n + c] = static_cast<std::uint8_t>((sum[c] + pixels / 2) / pixels);
    }
}

// Mean and std_grey over 3 x 3 cells.
__device__ CellColour colour_of_cell(const VolumeView& view, const ViewState& state, int n,
                                     const CarvingRules& rules) {
    CellColour out;
    if (!view.image) return out;
    const int columns = state.width + 2, corner = n / state.width * columns + n % state.width;
    for (int c = 0; c < 3; ++c) {
        float sum = 0, square = 0;  // whole numbers below 2^24: exact in any order
        for (int dy = 0; dy < 3; ++dy) {
            for (int dx = 0; dx < 3; ++dx) {
                const float value = view.means[3 * (corner + dy * columns + dx) + c];
                sum += value;
                square += value * value;
            }
        }
        const float mean = sum * (1 / 9.f), variance = square * (1 / 9.f) - mean * mean;
        out.mean[c] = static_cast<std::uint8_t>(mean + 0.5f);
        const auto std_grey = static_cast<std::uint8_t>(sqrtf(variance > 0 ? variance : 0.f) + 0.5f);
        out.limit[c] = colour_limit(std_grey, rules.max_difference_std, rules.noise_grey);
    }
    out.filled = 1;
    return out;
}

// Also prepares the first splats.
__global__ void cell_colours(const VolumeJob* __restrict__ job) {
    const VolumeView& view = job->views[blockIdx.y];
    const ViewState& state = job->view_states[blockIdx.y];
    const int cells = state.width * state.height;
    for (int n = thread_index(); n < cells; n += thread_count()) {
        view.colours[n] = colour_of_cell(view, state, n, job->rules);
        view.splats[0][n] = {kFar_m, 0};
    }
}

// A block a brick. Depths are positive, so that their bits are ordered as they are.
__global__ void __launch_bounds__(kBrickThreads)
    splat(const VolumeJob* __restrict__ job, int now, int round, int look) {
    __shared__ BrickSurface surface;
    __shared__ int nearest[kMaxViews];
    if (job->state->carved[round] == 0) return;  // nothing changed since the last look
    const int thread = static_cast<int>(threadIdx.x), bricks = job->state->bricks, views = job->view_count;
    if (thread < views) nearest[thread] = __float_as_int(kFar_m);
    for (int n = static_cast<int>(blockIdx.x); n < bricks; n += static_cast<int>(gridDim.x)) {
        find_surface(*job, job->occupancy[now], n, false, surface);
        if (thread == 0) job->surface[n] = surface.count;
        const BrickPosition brick = job->positions[n];
        for (int i = thread; i < surface.count * views; i += kBrickThreads) {
            const VolumeView& view = job->views[i % views];
            const VoxelCell cell = cell_of(job->lattice, brick, surface.voxels[i / views], view.camera,
                                           job->view_states[i % views]);
            if (cell.cell < 0) continue;
            const int depth = __float_as_int(cell.depth_m);
            DepthPair& depths = view.splats[look % 2][cell.cell];
            atomicMin(reinterpret_cast<int*>(&depths.front_m), depth);
            atomicMax(reinterpret_cast<int*>(&depths.back_m), depth);
            atomicMin(nearest + i % views, depth);
        }
    }
    __syncthreads();
    if (thread < views && nearest[thread] != __float_as_int(kFar_m))
        atomicMin(&job->view_states[thread].nearest[look % 2], nearest[thread]);
}

// Each cell takes the nearest front and the farthest back of the cells around it. Prepares the next splats.
__global__ void widen(const VolumeJob* __restrict__ job, int round, int look) {
    if (job->state->carved[round] == 0) return;
    const VolumeView& view = job->views[blockIdx.y];
    ViewState& state = job->view_states[blockIdx.y];
    const int width = state.width, height = state.height, now = look % 2;
    const DepthPair* const splats = view.splats[now];
    const int radius =
        splat_radius(view.camera, state.shift, __int_as_float(state.nearest[now]), job->lattice.voxel_m);
    for (int n = thread_index(); n < width * height; n += thread_count()) {
        const int x = n % width, y = n / width;
        DepthPair out{kFar_m, 0};
        for (int cy = max(y - radius, 0); cy <= min(y + radius, height - 1); ++cy) {
            for (int cx = max(x - radius, 0); cx <= min(x + radius, width - 1); ++cx) {
                const DepthPair near = splats[cy * width + cx];
                out.front_m = fminf(out.front_m, near.front_m);
                out.back_m = fmaxf(out.back_m, near.back_m);
            }
        }
        view.depths[n] = out;
        view.splats[1 - now][n] = {kFar_m, 0};
    }
    if (thread_index() == 0) {
        state.radius = radius;
        state.nearest[1 - now] = __float_as_int(kFar_m);
    }
}

// Foreground of the mask in [x0, x1) of a row.
__device__ int count_row(const BitMask& mask, int y, int x0, int x1) {
    const unsigned long long* words =
        mask.words + static_cast<std::size_t>(y - mask.box.y0) * mask.row_words();
    const int first = x0 - mask.box.x0, last = x1 - mask.box.x0;
    int count = 0;
    for (int k = first / 64; k * 64 < last; ++k) {
        unsigned long long word = words[k];
        if (k * 64 < first) word &= ~0ull << (first - k * 64);
        if (last - k * 64 < 64) word &= ~(~0ull << (last - k * 64));
        count += __popcll(word);
    }
    return count;
}

// The pixels of a cell if the volume's projection covers it, and how many of them are in the mask. The splats
// made the projection wider by their radius; a cell counts only if all within that radius are covered.
__device__ void count_cell(const VolumeView& view, const ViewState& state, int n, int& covered, int& both) {
    const int radius = state.radius, width = state.width, x = n % width, y = n / width;
    for (int cy = max(y - radius, 0); cy <= min(y + radius, state.height - 1); ++cy) {
        for (int cx = max(x - radius, 0); cx <= min(x + radius, width - 1); ++cx) {
            if (!(view.depths[cy * width + cx].front_m < kFar_m)) return;
        }
    }
    const int x0 = (x + state.cells.x0) << state.shift, y0 = (y + state.cells.y0) << state.shift;
    const int x1 = min(x0 + (1 << state.shift), view.camera.width);
    const int y1 = min(y0 + (1 << state.shift), view.camera.height);
    covered += (x1 - x0) * (y1 - y0);
    const Rect& box = view.mask.box;
    const int from = max(x0, box.x0), to = min(x1, box.x1);
    if (from >= to) return;
    for (int py = max(y0, box.y0); py < min(y1, box.y1); ++py) both += count_row(view.mask, py, from, to);
}

// A row of blocks a view.
__global__ void count_pixels(const VolumeJob* __restrict__ job) {
    __shared__ int sums[3];
    const VolumeView& view = job->views[blockIdx.y];
    ViewState& state = job->view_states[blockIdx.y];
    if (!view.mask.words) return;
    if (threadIdx.x < 3) sums[threadIdx.x] = 0;
    __syncthreads();
    int silhouette = 0, covered = 0, both = 0;
    const Rect& bounds = view.bounds;
    for (int y = bounds.y0 + thread_index(); y < bounds.y1; y += thread_count())
        silhouette += count_row(view.mask, y, bounds.x0, bounds.x1);
    for (int n = thread_index(); n < state.width * state.height; n += thread_count())
        count_cell(view, state, n, covered, both);
    if (silhouette > 0) atomicAdd(sums, silhouette);
    if (covered > 0) atomicAdd(sums + 1, covered), atomicAdd(sums + 2, both);
    __syncthreads();
    if (threadIdx.x < 3 && sums[threadIdx.x] > 0)
        atomicAdd(state.counts + threadIdx.x, static_cast<unsigned long long>(sums[threadIdx.x]));
}

dim3 cells_of(const VolumeBlocks& blocks, int views) {
    return dim3(blocks.cells, static_cast<unsigned>(views));
}

}  // namespace

void queue_views(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int views, int now) {
    frame_views<<<static_cast<unsigned>(views), kFrameThreads, 0, stream.get()>>>(job, now);
    cell_means<<<cells_of(blocks, views), kThreads, 0, stream.get()>>>(job);
    cell_colours<<<cells_of(blocks, views), kThreads, 0, stream.get()>>>(job);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_look(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int views, int now,
                int round, int look) {
    splat<<<blocks.bricks, kBrickThreads, 0, stream.get()>>>(job, now, round, look);
    widen<<<cells_of(blocks, views), kThreads, 0, stream.get()>>>(job, round, look);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_iou(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int views) {
    count_pixels<<<cells_of(blocks, views), kThreads, 0, stream.get()>>>(job);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
