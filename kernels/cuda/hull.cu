// The carver on the device: maps of the silhouettes, super-blocks, bricks, then a block of 512 threads a
// brick that is not empty. The host only sees the finished bricks, already in order.
#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include "kernels/cpu/hull.h"
#include "kernels/cpu/hull_maps.h"
#include "kernels/cpu/surrounded.h"
#include "kernels/cuda/device.h"
#include "kernels/cuda/forms.h"
#include "kernels/cuda/hull_device.cuh"
#include "kernels/cuda/hull_maps.h"

namespace kinevox::kernels {
namespace cuda {
namespace {

constexpr int kSuperEdge = 4;  // bricks

struct Grid3 {
    int x = 0, y = 0, z = 0;
    std::size_t count() const { return static_cast<std::size_t>(x) * y * z; }
};

__global__ void decide_super_blocks(HullQuestion q, Lattice lattice, Grid3 supers, BlockState* states) {
    const int n = thread_index();
    if (n >= supers.x * supers.y * supers.z) return;
    states[n] = decide_bricks(q, lattice, n % supers.x * kSuperEdge, n / supers.x % supers.y * kSuperEdge,
                              n / (supers.x * supers.y) * kSuperEdge, kSuperEdge);
}

// Also marks what is not empty, for the scan.
__global__ void decide_each_brick(HullQuestion q, Lattice lattice, Grid3 supers,
                                  const BlockState* super_states, Grid3 bricks, BlockState* states,
                                  int* kept) {
    const int n = thread_index();
    if (n >= bricks.x * bricks.y * bricks.z) return;
    const int x = n % bricks.x, y = n / bricks.x % bricks.y, z = n / (bricks.x * bricks.y);
    BlockState state = super_states[(z / kSuperEdge * supers.y + y / kSuperEdge) * supers.x + x / kSuperEdge];
    if (state == BlockState::kMixed) state = decide_bricks(q, lattice, x, y, z, 1);
    states[n] = state;
    kept[n] = state != BlockState::kEmpty;
}

__global__ void list_bricks(Grid3 grid, const BlockState* states, const int* place, Brick* out) {
    const int n = thread_index();
    if (n >= grid.x * grid.y * grid.z || states[n] == BlockState::kEmpty) return;
    Brick& brick = out[place[n]];
    brick.x = static_cast<std::int16_t>(n % grid.x);
    brick.y = static_cast<std::int16_t>(n / grid.x % grid.y);
    brick.z = static_cast<std::int16_t>(n / (grid.x * grid.y));
    brick.padding = 0;
}

// One block a brick, one thread a voxel; a warp's votes are 32 bits of the occupancy.
__global__ void carve_bricks(HullQuestion q, Lattice lattice, Grid3 grid, const BlockState* states,
                             Brick* bricks) {
    Brick& brick = bricks[blockIdx.x];
    const int bit = threadIdx.x;
    const BlockState state = states[(brick.z * grid.y + brick.y) * grid.x + brick.x];
    const bool inside =
        state == BlockState::kFull || voxel_inside(q, lattice, brick.x, brick.y, brick.z, bit);
    const unsigned votes = __ballot_sync(0xffffffffu, inside);
    if (bit % 32 == 0) reinterpret_cast<std::uint32_t*>(brick.occupancy)[bit / 32] = votes;
}

class CudaHullCarver final : public HullCarver {
  public:
    explicit CudaHullCarver(const HullOptions& options) : options_(options) {}

    void carve(std::span<const HullView> views, const Lattice& lattice, VoxelVolume& out) override {
        check_lattice(lattice);
        prepare_views(views, lattice);
        out.lattice = lattice;
        out.bricks.clear();
        out.colours.clear();
        if (silhouettes_.empty()) return;  // no view votes, and at least one must contain a voxel
        stream_.wait();
        const HullQuestion question{maps_.make(stream_, silhouettes_, options_.miss_budget_permille),
                                    static_cast<int>(silhouettes_.size()), options_.min_views};
        const Grid3 grid{lattice.size[0] / kBrickEdge, lattice.size[1] / kBrickEdge,
                         lattice.size[2] / kBrickEdge};
        const int count = decide(question, lattice, grid);
        if (count == 0) return;
        bricks_.resize(count);
        list_bricks<<<blocks(grid.count()), kThreads, 0, stream_.get()>>>(grid, states_.data(), place_.data(),
                                                                          bricks_.data());
        carve_bricks<<<count, kBrickVoxels, 0, stream_.get()>>>(question, lattice, grid, states_.data(),
                                                                bricks_.data());
        KINEVOX_CUDA_CHECK(cudaGetLastError());
        host_bricks_.resize(count);
        download(stream_, host_bricks_.data(), bricks_.data(), count);
        stream_.wait();
        for (int n = 0; n < count; ++n) {
            std::uint64_t any = 0;
            for (std::uint64_t slice : host_bricks_[n].occupancy) any |= slice;
            if (any) out.bricks.push_back(host_bricks_[n]);
        }
        filler_.fill(out, options_.fill_radius_m,
                     kFillLinesOfHull);  // on the host, where the bricks are by now
    }

  private:
    void prepare_views(std::span<const HullView> views, const Lattice& lattice) {
        silhouettes_.clear();
        for (const HullView& view : views) {
            if (!view.camera || !view.silhouette) continue;
            SilhouetteView silhouette;
            silhouette.camera = make_projector(*view.camera, "hull: camera");
            silhouette.mask = view.silhouette;
            silhouette.bounds = view.bounds;
            silhouette.block_radius_px =
                typical_block_radius_px(silhouette.camera, lattice, 0.5f * kBrickEdge * lattice.voxel_m);
            silhouettes_.push_back(silhouette);
        }
        if (silhouettes_.size() > kMaxViews) {
            throw std::invalid_argument("hull: " + std::to_string(silhouettes_.size()) + " views; at most " +
                                        std::to_string(kMaxViews));
        }
    }

    // Fills states_ and place_; returns the number of bricks that are not empty.
    int decide(const HullQuestion& question, const Lattice& lattice, const Grid3& grid) {
        const auto supers = [](int bricks) { return (bricks + kSuperEdge - 1) / kSuperEdge; };
        const Grid3 super_grid{supers(grid.x), supers(grid.y), supers(grid.z)};
        super_states_.resize(super_grid.count());
        states_.resize(grid.count());
        place_.resize(grid.count() + 1);
        decide_super_blocks<<<blocks(super_grid.count()), kThreads, 0, stream_.get()>>>(
            question, lattice, super_grid, super_states_.data());
        decide_each_brick<<<blocks(grid.count()), kThreads, 0, stream_.get()>>>(
            question, lattice, super_grid, super_states_.data(), grid, states_.data(), place_.data());
        KINEVOX_CUDA_CHECK(cudaGetLastError());
        const int bricks = static_cast<int>(grid.count());
        exclusive_scan(stream_, place_.data(), place_.data(), bricks);
        count_.resize(1);
        download(stream_, count_.data(), place_.data() + bricks, 1);
        stream_.wait();
        return count_[0];
    }

    HullOptions options_;
    HoleFiller filler_;
    Stream stream_;
    HullMapMaker maps_;
    std::vector<SilhouetteView> silhouettes_;
    DeviceBuffer<BlockState> super_states_, states_;  // x fastest
    DeviceBuffer<int> place_;                         // per brick of the lattice, its place in bricks_
    DeviceBuffer<Brick> bricks_;
    PinnedBuffer<Brick> host_bricks_;
    PinnedBuffer<int> count_;
};

}  // namespace
}  // namespace cuda

std::unique_ptr<HullCarver> make_hull_carver_cuda(const HullOptions& options) {
    cuda::require_gpu("hull");
    return std::make_unique<cuda::CudaHullCarver>(options);
}

}  // namespace kinevox::kernels
