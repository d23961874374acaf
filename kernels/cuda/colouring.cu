// Voxel colouring on the device, step for step as kernels/cpu/colouring.cc: each round marks voxels on a
// snapshot, then clears them, so that no order of threads shows.
#include <algorithm>
#include <cmath>
#include <vector>

#include "kernels/cpu/colouring.h"
#include "kernels/cpu/colouring_steps.h"
#include "kernels/cpu/hull_maps.h"
#include "kernels/cuda/device.h"
#include "kernels/cuda/forms.h"
#include "kernels/cuda/hull_device.cuh"
#include "kernels/cuda/hull_maps.h"
#include "kernels/cuda/surface.h"
#include "kernels/cuda/surrounded.h"
#include "kernels/cuda/views.h"
#include "kernels/shared/surrounded.h"

namespace kinevox::kernels {
namespace cuda {
namespace {

constexpr int kWords = kBrickVoxels / 32;  // of a brick's occupancy
constexpr int kMarkThreads = 64;

__device__ std::uint32_t* words_of(Brick& brick) {
    return reinterpret_cast<std::uint32_t*>(brick.occupancy);
}

// One block a brick, one thread a voxel: clears what sticks out of the sharp silhouettes.
__global__ void carve_outside(HullQuestion q, Lattice lattice, Brick* bricks, unsigned long long* carved) {
    __shared__ BlockState whole;
    __shared__ int gone;
    Brick& brick = bricks[blockIdx.x];
    const int bit = threadIdx.x;
    if (bit == 0) {
        whole = decide_bricks(q, lattice, brick.x, brick.y, brick.z, 1);
        gone = 0;
    }
    __syncthreads();
    if (whole == BlockState::kFull) return;
    const unsigned kept =
        __ballot_sync(0xffffffffu, voxel_inside(q, lattice, brick.x, brick.y, brick.z, bit));
    if (bit % 32 == 0) {
        std::uint32_t& word = words_of(brick)[bit / 32];
        atomicAdd(&gone, __popc(word & ~kept));
        word &= kept;
    }
    __syncthreads();
    if (bit == 0 && gone > 0) atomicAdd(carved, static_cast<unsigned long long>(gone));
}

struct Rules {
    float voxel_m = 0;
    bool by_colour = false;  // colours carve
    float min_ray_length_m = 0;
    int support_radius = 0;     // voxels
    int min_support_count = 0;  // 0: no rounding
};

struct ViewSet {
    const ViewOnDevice* views = nullptr;
    int count = 0;
    VoxelCells cells;
};

// True where every ray through the voxel has enough of the volume to spare it.
__device__ bool can_spare(const ViewSet& set, int n, const Rules& rules) {
    for (int v = 0; v < set.count; ++v) {
        const ViewOnDevice& view = set.views[v];
        const int cell = set.cells.at(v, n).cell;
        if (cell >= 0 && view.back_m[cell] - view.front_m[cell] < rules.min_ray_length_m) return false;
    }
    return true;
}

__device__ bool sees(const ViewOnDevice& view, const VoxelCell& at, float facing, float voxel_m) {
    return at.cell >= 0 && at.depth_m <= view.front_m[at.cell] + seen_within(facing, voxel_m);
}

__device__ bool colours_disagree(const ViewSet& set, const SurfaceVoxel& voxel, int n, const Rules& rules) {
    if (!rules.by_colour) return false;
    const CellColour* seen[kMaxViews];
    int count = 0;
    float normal[3];
    open_normal(voxel.open, normal);
    for (int v = 0; v < set.count; ++v) {
        const ViewOnDevice& view = set.views[v];
        const VoxelCell at = set.cells.at(v, n);
        if (!sees(view, at, facing_of(view.camera, normal), rules.voxel_m)) continue;
        const CellColour& colour = view.colours[at.cell];
        if (!colour.filled) continue;
        for (int other = 0; other < count; ++other) {
            if (disagree(colour, *seen[other])) return true;
        }
        seen[count++] = &colour;
    }
    return false;
}

// Occupied voxels in the cube of 2 * radius + 1 around voxel `bit` of the middle one of 27 bricks, row by
// row.
__device__ int count_support(const std::uint64_t (*bricks)[kBrickEdge], int bit, int radius) {
    const int x = bit & 7, y = bit >> 3 & 7, z = bit >> 6;
    const unsigned row_mask = (1u << (2 * radius + 1)) - 1;
    int count = 0;
    for (int gz = z - radius + kBrickEdge; gz <= z + radius + kBrickEdge; ++gz) {
        for (int gy = y - radius + kBrickEdge; gy <= y + radius + kBrickEdge; ++gy) {
            const std::uint64_t(*row_of_bricks)[kBrickEdge] =
                bricks + (gz / kBrickEdge * 3 + gy / kBrickEdge) * 3;
            const int slice = gz % kBrickEdge, shift = gy % kBrickEdge * 8;
            unsigned row = 0;  // 24 voxels along x, the middle brick's from bit 8 on
            for (int b = 0; b < 3; ++b) {
                row |= static_cast<unsigned>(row_of_bricks[b][slice] >> shift & 255) << (8 * b);
            }
            count += __popc(row >> (x + kBrickEdge - radius) & row_mask);
        }
    }
    return count;
}

// One block a brick; marks: 16 words a brick, one bit a voxel that goes. `last_marks` are those of the round
// before, null in the first: where they took nothing from a brick or the 26 around it, the answer would be
// the same again.
__global__ void mark_voxels(const Brick* bricks, BrickTable table, SurfaceList surface, ViewSet set,
                            Rules rules, const std::uint32_t* last_marks, std::uint32_t* marks) {
    __shared__ std::uint64_t around[27][kBrickEdge];
    __shared__ std::uint32_t marked[kWords];
    const int brick = blockIdx.x, thread = threadIdx.x;
    const Brick& centre = bricks[brick];
    if (thread < kWords) marked[thread] = 0;
    bool changed = last_marks == nullptr;
    for (int n = thread; n < 27 * kBrickEdge; n += kMarkThreads) {
        const int neighbour = n / kBrickEdge;
        const int found = table.index[table.at(centre.x + neighbour % 3 - 1, centre.y + neighbour / 3 % 3 - 1,
                                               centre.z + neighbour / 9 - 1)];
        around[neighbour][n % kBrickEdge] = found < 0 ? 0 : bricks[found].occupancy[n % kBrickEdge];
        if (last_marks && found >= 0) {
            const std::uint32_t* words = last_marks + found * kWords + n % kBrickEdge * 2;
            changed = changed || (words[0] | words[1]) != 0;
        }
    }
    const int first = surface.first[brick];
    const int last = __syncthreads_or(changed) ? surface.first[brick + 1] : first;
    for (int n = first + thread; n < last; n += kMarkThreads) {
        const SurfaceVoxel& voxel = surface.voxels[n];
        const int bit = voxel.bit;
        const bool thin = rules.min_support_count > 0 &&
                          count_support(around, bit, rules.support_radius) < rules.min_support_count;
        if (can_spare(set, n, rules) && (thin || colours_disagree(set, voxel, n, rules))) {
            atomicOr(&marked[bit / 32], 1u << (bit % 32));
        }
    }
    __syncthreads();
    if (thread < kWords) marks[brick * kWords + thread] = marked[thread];
}

// A thread a word of 32 voxels. Only surface voxels are marked, so each mark is a voxel carved.
__global__ void clear_marked(Brick* bricks, int count, const std::uint32_t* marks,
                             unsigned long long* carved) {
    __shared__ int gone;
    if (threadIdx.x == 0) gone = 0;
    __syncthreads();
    const int n = thread_index();
    if (n < count * kWords && marks[n] != 0) {
        words_of(bricks[n / kWords])[n % kWords] &= ~marks[n];
        atomicAdd(&gone, __popc(marks[n]));
    }
    __syncthreads();
    if (threadIdx.x == 0 && gone > 0) atomicAdd(carved, static_cast<unsigned long long>(gone));
}

__global__ void paint(SurfaceList surface, ViewSet set, float voxel_m, Colour* colours) {
    const int n = thread_index();
    if (n >= surface.count) return;
    float normal[3], sum[3] = {}, weights = 0;
    open_normal(surface.voxels[n].open, normal);
    for (int v = 0; v < set.count; ++v) {
        const ViewOnDevice& view = set.views[v];
        const VoxelCell at = set.cells.at(v, n);
        if (at.cell < 0 || !view.image) continue;
        const float facing = facing_of(view.camera, normal);
        float weight = colour_weight(facing, at.depth_m);
        if (!sees(view, at, facing, voxel_m)) weight *= kHiddenWeight;
        const std::uint8_t* mean = view.means + 3 * mean_index(at.cell, view.width);
        for (int c = 0; c < 3; ++c) sum[c] += weight * static_cast<float>(mean[c]);
        weights += weight;
    }
    Colour colour;
    if (weights > 0) {
        colour.b = static_cast<std::uint8_t>(sum[0] / weights + 0.5f);
        colour.g = static_cast<std::uint8_t>(sum[1] / weights + 0.5f);
        colour.r = static_cast<std::uint8_t>(sum[2] / weights + 0.5f);
    }
    colours[n] = colour;
}

class CudaVoxelColourer final : public VoxelColourer {
  public:
    explicit CudaVoxelColourer(const ColouringOptions& options)
        : options_(options), cpu_(make_voxel_colourer_cpu(options)) {}

    void colour(std::span<const ColouringView> views, VoxelVolume& volume, ColouringReport& report) override {
        check_colouring_views(views);
        if (views.empty() || volume.bricks.empty()) return cpu_->colour(views, volume, report);
        report = {};
        const Lattice lattice = volume.lattice;
        stream_.wait();
        volume_.load(stream_, volume);
        carved_.resize(1);
        host_carved_.resize(1);
        if (options_.max_rounds > 0) {
            report.carved += carve_by_sharp(views, lattice);
            report.carved -= fill_holes(lattice);
        }
        views_.frame(stream_, views, lattice, volume_, options_.max_colour_difference_std,
                     options_.noise_grey);
        while (report.rounds < options_.max_rounds) {
            const std::int64_t carved = carve_round(lattice, report.rounds);
            ++report.rounds;
            report.carved += carved;
            if (carved == 0) break;
        }
        const SurfaceList surface = volume_.find_surface(stream_);
        views_.look(stream_, lattice, surface);
        if (surface.count > 0) {
            colours_.resize(surface.count);
            host_colours_.resize(surface.count);
            paint<<<blocks(surface.count), kThreads, 0, stream_.get()>>>(surface, view_set(), lattice.voxel_m,
                                                                         colours_.data());
            KINEVOX_CUDA_CHECK(cudaGetLastError());
            download(stream_, host_colours_.data(), colours_.data(), surface.count);
        }
        report.silhouette_iou = views_.silhouette_iou(stream_, lattice.voxel_m);
        volume_.store(stream_, volume);
        volume.colours.assign(host_colours_.data(), host_colours_.data() + surface.count);
    }

  private:
    ViewSet view_set() const { return {views_.views(), views_.count(), views_.voxel_cells()}; }

    std::int64_t carve_by_sharp(std::span<const ColouringView> views, const Lattice& lattice) {
        if (options_.sharp_budget_permille < 0) return 0;
        sharp_.clear();
        for (const ColouringView& view : views) {
            if (!view.sharp) continue;
            SilhouetteView sharp;
            sharp.camera = make_projector(*view.camera, "colouring: camera");
            sharp.mask = view.sharp;
            sharp.bounds = view.bounds.empty()
                               ? bounds_of(view.sharp, sharp.camera.width, sharp.camera.height)
                               : view.bounds;
            sharp.block_radius_px =
                typical_block_radius_px(sharp.camera, lattice, 0.5f * kBrickEdge * lattice.voxel_m);
            sharp_.push_back(sharp);
        }
        if (sharp_.empty()) return 0;
        const HullQuestion question{maps_.make(stream_, sharp_, options_.sharp_budget_permille),
                                    static_cast<int>(sharp_.size()), 0};
        fill_bytes(stream_, carved_.data(), 0, 1);
        carve_outside<<<volume_.brick_count(), kBrickVoxels, 0, stream_.get()>>>(
            question, lattice, volume_.bricks(), carved_.data());
        KINEVOX_CUDA_CHECK(cudaGetLastError());
        return read_carved();
    }

    std::int64_t fill_holes(const Lattice& lattice) {
        const int fill_radius = fill_radius_voxels(options_.fill_radius_m, lattice.voxel_m);
        if (fill_radius < 1) return 0;
        fill_bytes(stream_, carved_.data(), 0, 1);
        for (int pass = 0; pass < kFillPassesOfColouring; ++pass) {
            fill_surrounded(stream_, volume_, fill_radius, kFillLinesOfColouring, marks_[0], carved_.data());
        }
        return read_carved();
    }

    std::int64_t carve_round(const Lattice& lattice, int round) {
        const SurfaceList surface = volume_.find_surface(stream_);
        views_.look(stream_, lattice, surface);
        if (surface.count == 0) return 0;
        Rules rules;
        rules.voxel_m = lattice.voxel_m;
        rules.by_colour = options_.max_colour_difference_std > 0;
        rules.min_ray_length_m = options_.min_ray_length_m;
        rules.support_radius =
            std::clamp(static_cast<int>(std::lround((options_.support_edge_m / lattice.voxel_m - 1) / 2)), 1,
                       kMaxSupportRadius);
        const int edge = 2 * rules.support_radius + 1;
        rules.min_support_count =
            static_cast<int>(options_.min_support * static_cast<float>(edge * edge * edge));
        const int bricks = volume_.brick_count();
        DeviceBuffer<std::uint32_t>&marks = marks_[round % 2], &last_marks = marks_[(round + 1) % 2];
        marks.resize(static_cast<std::size_t>(bricks) * kWords);
        fill_bytes(stream_, carved_.data(), 0, 1);
        mark_voxels<<<bricks, kMarkThreads, 0, stream_.get()>>>(
            volume_.bricks(), volume_.table(), surface, view_set(), rules,
            round > 0 ? last_marks.data() : nullptr, marks.data());
        clear_marked<<<blocks(marks.size()), kThreads, 0, stream_.get()>>>(volume_.bricks(), bricks,
                                                                           marks.data(), carved_.data());
        KINEVOX_CUDA_CHECK(cudaGetLastError());
        return read_carved();
    }

    std::int64_t read_carved() {
        download(stream_, host_carved_.data(), carved_.data(), 1);
        stream_.wait();
        return static_cast<std::int64_t>(host_carved_[0]);
    }

    ColouringOptions options_;
    std::unique_ptr<VoxelColourer> cpu_;  // for what is empty
    Stream stream_;
    DeviceVolume volume_;
    DeviceViews views_;
    HullMapMaker maps_;
    std::vector<SilhouetteView> sharp_;
    DeviceBuffer<std::uint32_t> marks_[2];  // of this round and the one before
    DeviceBuffer<unsigned long long> carved_;
    DeviceBuffer<Colour> colours_;
    PinnedBuffer<unsigned long long> host_carved_;
    PinnedBuffer<Colour> host_colours_;
};

}  // namespace
}  // namespace cuda

std::unique_ptr<VoxelColourer> make_voxel_colourer_cuda(const ColouringOptions& options) {
    cuda::require_gpu("colouring");
    return std::make_unique<cuda::CudaVoxelColourer>(options);
}

}  // namespace kinevox::kernels
