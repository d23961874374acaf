#pragma once

#include <cstdint>
#include <vector>

#include "kernels/cpu/surface.h"
#include "kernels/shared/surrounded.h"

namespace kinevox::kernels {

// Keeps its working memory from call to call.
class HoleFiller {
  public:
    // Fills the empty voxels of the volume's bricks that have an occupied voxel within `radius_m` on both
    // sides along at least `min_lines` of the kFillLines lines through them; all from the volume as it was.
    // Returns how many.
    std::int64_t fill(VoxelVolume& volume, float radius_m, int min_lines);

  private:
    BrickGrid grid_;
    std::vector<std::uint64_t> filled_;  // as occupancy
};

}  // namespace kinevox::kernels
