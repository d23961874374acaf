// Volumes as PLY files.
#pragma once

#include <absl/status/status.h>

#include <filesystem>

#include "common/volume.h"

namespace kinevox {

// The centres of the surface voxels as points: binary little endian, float x y z (m, world) and uchar red
// green blue (grey if the volume has no colours). Atomic.
absl::Status write_volume_ply(const Volume& volume, const std::filesystem::path& file);

}  // namespace kinevox
