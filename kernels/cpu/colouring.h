#pragma once

#include <memory>
#include <span>

#include "kernels/colouring.h"

namespace kinevox::kernels {

std::unique_ptr<VoxelColourer> make_voxel_colourer_cpu(const ColouringOptions& options);

// Throws std::invalid_argument, see VoxelColourer::colour().
void check_colouring_views(std::span<const ColouringView> views);

}  // namespace kinevox::kernels
