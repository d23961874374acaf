// Which surface voxels a round of carving takes: those that the rays spare and whose colours disagree, or
// that stand out of the volume.
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
    float keep_on_ray_m = 0;               // of the volume, that every ray through a voxel must keep
};

// Looks at the surface voxels [first, last), which are one brick's. `thin` has a bit for each voxel of the
// brick that has too little of the volume around it; bits of voxels to go are set in `marks`; both as
// Brick::occupancy.
void mark_voxels(const CarvingEvidence& evidence, const Surface& surface, int first, int last,
                 const std::uint64_t* thin, std::uint64_t* marks);

}  // namespace kinevox::kernels
