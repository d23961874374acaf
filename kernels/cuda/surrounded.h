#pragma once

#include <cstdint>

#include "kernels/cuda/surface.h"

namespace kinevox::kernels::cuda {

// Fills the volume's holes as kernels/cpu/surrounded.h; `fill` is working memory. Queued.
void fill_surrounded(const Stream& stream, const DeviceVolume& volume, int radius, int min_lines,
                     DeviceBuffer<std::uint32_t>& fill, unsigned long long* filled);

}  // namespace kinevox::kernels::cuda
