// Connected components of masks on the device, by one block of threads for a mask; see components.cu.
#pragma once

#include <cstddef>

#include "kernels/cuda/device.h"
#include "kernels/cuda/segmentation_steps.h"

namespace kinevox::kernels::cuda {

// Memory for the runs of one mask of this size, the worst one, and the lists in it.
std::size_t run_list_size(int width, int height);  // ints
RunLists run_lists(int* memory, int width, int height);

}  // namespace kinevox::kernels::cuda
