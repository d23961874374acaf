// Separates the subject from other foreground, such as moved furniture or changed light. Other cameras do not
// see these at the same position, so the volume excludes them.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "common/geometry.h"
#include "kernels/segmentation.h"
#include "kernels/types.h"

namespace kinevox {

// The largest connected component (by faces) of a volume above the floor, with the components above and below
// it; its centre in the world.
struct MainBody {
    kernels::VoxelVolume volume;
    Vec3 centre_in_world;
};
std::optional<MainBody> main_body(const kernels::VoxelVolume& coarse);

// The part of a volume inside a coarser one with the same origin and voxels `factor` times as large.
kernels::VoxelVolume inside_of(const kernels::VoxelVolume& fine, const kernels::VoxelVolume& coarse,
                               int factor);

// Fraction of the sharp silhouette outside the volume's projection dilated by `dilate_px`, 0..1; writes the
// projection to `mask`.
double fraction_outside(const kernels::Silhouettes& seen, const kernels::VoxelVolume& volume,
                        const kernels::CameraModel& camera, int dilate_px, std::vector<std::uint8_t>& mask);
// `seen` restricted to `mask`, which is 0 outside `box`; without probabilities. Only what `out.searched`
// covered is cleared, so `out` is empty or what an earlier call made.
void apply_mask(const kernels::Silhouettes& seen, const std::vector<std::uint8_t>& mask,
                const kernels::Rect& box, kernels::Silhouettes& out);

}  // namespace kinevox
