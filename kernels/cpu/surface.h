// The surface of a brick volume as a flat list, in the order of VoxelVolume::colours.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/shared/bricks.h"
#include "kernels/shared/visibility.h"
#include "kernels/types.h"

namespace kinevox::kernels {

// Looks up bricks by their index in the lattice. Bricks outside the lattice are absent.
class BrickGrid {
  public:
    void build(const VoxelVolume& volume);
    int find(int x, int y, int z) const {  // index into volume.bricks, or -1; each -1 .. size is allowed
        return index_[(static_cast<std::size_t>(z + 1) * ny_ + (y + 1)) * nx_ + (x + 1)];
    }
    BrickNeighbours neighbours(const VoxelVolume& volume, int brick) const;

  private:
    int nx_ = 0, ny_ = 0;  // with a rim of one
    std::vector<int> index_;
};

// Arrays of one entry a surface voxel, and a few more at their end for what reads them as vectors.
struct Surface {
    std::vector<float> x_m, y_m, z_m;  // centres, world
    std::vector<std::uint16_t> bit;    // z * 64 + y * 8 + x inside the brick
    std::vector<std::uint8_t> open;    // sides without a neighbour: bit 0 -x, 1 +x, 2 -y, 3 +y, 4 -z, 5 +z
    std::vector<int> first;            // per brick, its first voxel; one entry more at the end

    int size() const { return first.empty() ? 0 : first.back(); }
    void build(const VoxelVolume& volume, const BrickGrid& grid);
};

}  // namespace kinevox::kernels
