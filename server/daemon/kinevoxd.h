// The daemon as a function, so that a test can give it a GPU that fails.
#pragma once

#include <functional>
#include <memory>

#include "kernels/stages.h"

namespace kinevox {

// Called once, with the GPU that the configuration requests, if it does.
using MakeGpu = std::function<std::unique_ptr<const kernels::StageFactory>(kernels::Device)>;

// Returns the exit status.
int run_kinevoxd(int argc, char** argv, const MakeGpu& make_gpu);

}  // namespace kinevox
