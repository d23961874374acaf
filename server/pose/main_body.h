// What of the silhouettes is the subject, where the segmentation shows more than that: furniture that was
// moved, light that changed. Other cameras do not see such things at the same place, so the volume knows.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "common/geometry.h"
#include "kernels/segmentation.h"
#include "kernels/types.h"

namespace kinevox {

// The largest connected part (by faces) of a volume, with the parts over and under it, as far as it stands
// above the floor; its centre in the world.
struct MainBody {
    kernels::VoxelVolume volume;
    Vec3 centre_in_world;
};
std::optional<MainBody> main_body(const kernels::VoxelVolume& coarse);

// What of a volume lies in the voxels of a coarser one with the same origin and `factor` times its voxels.
kernels::VoxelVolume inside_of(const kernels::VoxelVolume& fine, const kernels::VoxelVolume& coarse,
                               int factor);

// Part of the sharp silhouette outside of the volume's projection widened by `dilate_px`, 0..1; the
// projection in `mask`.
double part_outside(const kernels::Silhouettes& seen, const kernels::VoxelVolume& volume,
                    const kernels::CameraModel& camera, int dilate_px, std::vector<std::uint8_t>& mask);
// `seen` without what `mask` does not cover.
void cut_to_mask(const kernels::Silhouettes& seen, const std::vector<std::uint8_t>& mask,
                 kernels::Silhouettes& out);

}  // namespace kinevox
