// What the host prepares for a device, by several threads.
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "kernels/types.h"

namespace kinevox::kernels::cpu {

// Copies rows [y0, y1) of `image` to where they lie in an image without padding at `to`.
void copy_rows(const ImageView& image, int y0, int y1, std::uint8_t* to);

// A bit per pixel of `mask`, width bytes a row, for those that are not 0: a word for each 64 pixels of a row,
// the first one in its lowest bit.
void pack_mask(const std::uint8_t* mask, int width, int height, unsigned long long* words);

// Calls all, in any order and on any thread.
void run_all(std::span<const std::function<void()>> tasks);

}  // namespace kinevox::kernels::cpu
