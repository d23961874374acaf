// The kernels' plain types from the common ones.
#pragma once

#include "common/camera.h"
#include "kernels/types.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

kernels::CameraModel to_kernel(const Camera& camera);
// Shares the image's memory.
kernels::ImageView to_kernel(const Image& image);

}  // namespace kinevox
