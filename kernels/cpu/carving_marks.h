// Selects the surface voxels that a round carves: photo-inconsistent or unsupported ones whose rays keep
// enough of the volume.
#pragma once

#include <cstdint>
#include <span>

#include "kernels/cpu/cell_colours.h"
#include "kernels/cpu/surface.h"
#include "kernels/cpu/visibility.h"

namespace kinevox::kernels {

struct CarvingEvidence {
    std::span<const ViewOfVolume> views;
    std::span<const CellColours> colours;  // per view
    float min_ray_length_m = 0;            // minimum length of the volume along every ray
};

// Tests the surface voxels [first, last) of one brick. `unsupported` has a bit for each voxel of the brick
// with too few occupied voxels around it; sets the bits of voxels to carve in `marks`; both as
// Brick::occupancy.
void mark_voxels(const CarvingEvidence& evidence, const Surface& surface, int first, int last,
                 const std::uint64_t* unsupported, std::uint64_t* marks);

}  // namespace kinevox::kernels
