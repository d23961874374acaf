#pragma once

#include "kernels/hull.h"

namespace kinevox::kernels::cuda {

// Null if the carver is not the CUDA form.
const HullOptions* options_of(const HullCarver& carver);

}  // namespace kinevox::kernels::cuda
