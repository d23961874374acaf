// Volumes as PLY files, which every 3-D program opens.
#pragma once

#include <absl/status/status.h>

#include <filesystem>

#include "common/volume.h"

namespace kinevox {

// The centres of the surface voxels as points: binary little endian, float x y z (m, world) and uchar red
// green blue (grey where the volume has no colours). Written aside and renamed.
absl::Status write_volume_ply(const Volume& volume, const std::filesystem::path& file);

}  // namespace kinevox
