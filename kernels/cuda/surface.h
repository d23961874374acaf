// A brick volume and its surface on the device.
#pragma once

#include <cstdint>

#include "kernels/cuda/device.h"
#include "kernels/shared/bricks.h"
#include "kernels/shared/visibility.h"

namespace kinevox::kernels::cuda {

// Looks up bricks by their index in the lattice; device pointers. A rim of one lies around the lattice.
struct BrickTable {
    const int* index = nullptr;  // into the bricks, or -1; x fastest
    int nx = 0, ny = 0;          // with the rim

    __host__ __device__ std::size_t at(int x, int y, int z) const {  // each -1 .. size
        return (static_cast<std::size_t>(z + 1) * ny + (y + 1)) * nx + (x + 1);
    }
};

struct SurfaceList {
    const SurfaceVoxel* voxels = nullptr;  // in the order of VoxelVolume::colours
    const int* first = nullptr;            // per brick, its first voxel; one entry more at the end
    int count = 0;
};

// Bricks that lose their last voxel stay in the list, without surface, so that indices never change.
class DeviceVolume {
  public:
    // Queues the copy. The stream must have been waited for since the last call.
    void load(const Stream& stream, const VoxelVolume& volume);

    // The surface as the bricks are now; waits for its size.
    SurfaceList find_surface(const Stream& stream);

    // Puts the bricks that are not empty into `volume`; waits.
    void store(const Stream& stream, VoxelVolume& volume);

    int brick_count() const { return static_cast<int>(bricks_.size()); }
    Brick* bricks() const { return bricks_.data(); }
    const BrickTable& table() const { return table_; }

  private:
    PinnedBuffer<Brick> host_bricks_;
    PinnedBuffer<int> host_count_;
    DeviceBuffer<Brick> bricks_;
    DeviceBuffer<int> index_, first_;
    DeviceBuffer<std::uint64_t> slices_;  // of the surface, 8 a brick
    DeviceBuffer<SurfaceVoxel> voxels_;
    BrickTable table_;
};

}  // namespace kinevox::kernels::cuda
