#pragma once

#include <cstdint>

#include "kernels/colouring.h"
#include "kernels/cpu/visibility.h"

namespace kinevox::kernels {

// Smallest box around the pixels that are not 0.
Rect bounds_of(const std::uint8_t* mask, int width, int height);

// Intersection over union of the volume's projection (of_volume.depths, as splat_depth() left it) and the
// view's sharp silhouette, else its loose one; NaN where there is none or both are empty.
float silhouette_agreement(const ColouringView& view, const ViewOfVolume& of_volume);

}  // namespace kinevox::kernels
