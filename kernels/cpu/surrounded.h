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
    // sides along at least `min_lines` of the kFillLines lines through them; all from the volume as it was
    // before each of the passes. Returns how many.
    std::int64_t fill(VoxelVolume& volume, float radius_m, int min_lines, int passes = 1);

  private:
    std::int64_t add_filled(VoxelVolume& volume);
    bool filled_around(const Brick& brick) const;

    BrickGrid grid_;
    std::vector<std::uint64_t> filled_;     // of the pass, as occupancy
    std::vector<std::uint8_t> has_filled_;  // per brick, in the last pass
};

}  // namespace kinevox::kernels
