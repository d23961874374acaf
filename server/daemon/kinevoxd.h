// The daemon as a function, so that a test can give it a GPU that fails.
#pragma once

#include <functional>
#include <memory>

#include "kernels/stages.h"

namespace kinevox {

// `make_gpu` is asked once, where the configuration wants a GPU. Returns the exit status.
int run_kinevoxd(int argc, char** argv,
                 const std::function<std::unique_ptr<const kernels::StageMaker>()>& make_gpu);

}  // namespace kinevox
