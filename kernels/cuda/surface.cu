#include <algorithm>

#include "kernels/cuda/surface.h"

namespace kinevox::kernels::cuda {
namespace {

__global__ void index_bricks(const Brick* bricks, int count, BrickTable table, int* index) {
    const int n = thread_index();
    if (n < count) index[table.at(bricks[n].x, bricks[n].y, bricks[n].z)] = n;
}

__device__ BrickNeighbours neighbours_of(const Brick* bricks, const BrickTable& table, int brick) {
    const Brick& b = bricks[brick];
    BrickNeighbours out;
    out.self = b.occupancy;
    const auto at = [&](int dx, int dy, int dz) -> const std::uint64_t* {
        const int found = table.index[table.at(b.x + dx, b.y + dy, b.z + dz)];
        return found < 0 ? nullptr : bricks[found].occupancy;
    };
    out.side[0] = at(-1, 0, 0), out.side[1] = at(1, 0, 0);
    out.side[2] = at(0, -1, 0), out.side[3] = at(0, 1, 0);
    out.side[4] = at(0, 0, -1), out.side[5] = at(0, 0, 1);
    return out;
}

// A thread a slice; the eight of a brick lie in one warp.
__global__ void surface_slices(const Brick* bricks, int count, BrickTable table, std::uint64_t* slices,
                               int* voxels_of_brick) {
    const int n = thread_index(), brick = n / kBrickEdge, k = n % kBrickEdge;
    std::uint64_t slice = 0;
    if (brick < count) {
        slice = surface_slice(neighbours_of(bricks, table, brick), k);
        slices[n] = slice;
    }
    int voxels = __popcll(slice);
    for (int step = 1; step < kBrickEdge; step *= 2) voxels += __shfl_xor_sync(0xffffffffu, voxels, step);
    if (brick < count && k == 0) voxels_of_brick[brick] = voxels;
}

__global__ void list_surface(const Brick* bricks, int count, BrickTable table, const std::uint64_t* slices,
                             const int* first, SurfaceVoxel* out) {
    const int n = thread_index(), brick = n / kBrickEdge, k = n % kBrickEdge;
    if (brick >= count || slices[n] == 0) return;
    int place = first[brick];
    for (int before = n - k; before < n; ++before) place += __popcll(slices[before]);
    const BrickNeighbours around = neighbours_of(bricks, table, brick);
    std::uint64_t side[6];
    for (int direction = 0; direction < 6; ++direction)
        side[direction] = ~neighbour_slice(around, k, direction);
    for (std::uint64_t slice = slices[n]; slice; slice &= slice - 1) {
        const int bit = __ffsll(static_cast<long long>(slice)) - 1;
        SurfaceVoxel voxel;
        voxel.x = static_cast<std::int16_t>(bricks[brick].x * kBrickEdge + (bit & 7));
        voxel.y = static_cast<std::int16_t>(bricks[brick].y * kBrickEdge + (bit >> 3));
        voxel.z = static_cast<std::int16_t>(bricks[brick].z * kBrickEdge + k);
        voxel.bit = static_cast<std::uint16_t>(k * 64 + bit);
        voxel.brick = brick;
        unsigned open = 0;
        for (int direction = 0; direction < 6; ++direction) {
            open |= static_cast<unsigned>(side[direction] >> bit & 1) << direction;
        }
        voxel.open = static_cast<std::uint8_t>(open);
        out[place++] = voxel;
    }
}

}  // namespace

void DeviceVolume::load(const Stream& stream, const VoxelVolume& volume) {
    host_bricks_.resize(volume.bricks.size());
    std::copy(volume.bricks.begin(), volume.bricks.end(), host_bricks_.data());
    upload(stream, bricks_, host_bricks_);
    const int* size = volume.lattice.size;
    table_.nx = size[0] / kBrickEdge + 2;
    table_.ny = size[1] / kBrickEdge + 2;
    index_.resize(static_cast<std::size_t>(table_.nx) * table_.ny * (size[2] / kBrickEdge + 2));
    table_.index = index_.data();
    fill_bytes(stream, index_.data(), 0xff, index_.size());  // -1
    if (brick_count() > 0) {
        index_bricks<<<blocks(bricks_.size()), kThreads, 0, stream.get()>>>(bricks_.data(), brick_count(),
                                                                            table_, index_.data());
        KINEVOX_CUDA_CHECK(cudaGetLastError());
    }
}

SurfaceList DeviceVolume::find_surface(const Stream& stream) {
    const int count = brick_count();
    first_.resize(count + 1);
    slices_.resize(static_cast<std::size_t>(count) * kBrickEdge);
    if (count == 0) return {};
    surface_slices<<<blocks(slices_.size()), kThreads, 0, stream.get()>>>(bricks_.data(), count, table_,
                                                                          slices_.data(), first_.data());
    KINEVOX_CUDA_CHECK(cudaGetLastError());
    exclusive_scan(stream, first_.data(), first_.data(), count);
    host_count_.resize(1);
    download(stream, host_count_.data(), first_.data() + count, 1);
    stream.wait();
    voxels_.resize(host_count_[0]);
    if (host_count_[0] > 0) {
        list_surface<<<blocks(slices_.size()), kThreads, 0, stream.get()>>>(
            bricks_.data(), count, table_, slices_.data(), first_.data(), voxels_.data());
        KINEVOX_CUDA_CHECK(cudaGetLastError());
    }
    return {voxels_.data(), first_.data(), host_count_[0]};
}

void DeviceVolume::store(const Stream& stream, VoxelVolume& volume) {
    download(stream, host_bricks_.data(), bricks_.data(), bricks_.size());
    stream.wait();
    volume.bricks.clear();
    for (std::size_t n = 0; n < bricks_.size(); ++n) {
        std::uint64_t any = 0;
        for (std::uint64_t slice : host_bricks_[n].occupancy) any |= slice;
        if (any) volume.bricks.push_back(host_bricks_[n]);
    }
}

}  // namespace kinevox::kernels::cuda
