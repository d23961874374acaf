// Copies of images for a device, by several threads.
#pragma once

#include <cstdint>

#include "kernels/types.h"

namespace kinevox::kernels::cpu {

// Copies the rows of `image` to `to`, without padding.
void copy_image(const ImageView& image, std::uint8_t* to);

}  // namespace kinevox::kernels::cpu
