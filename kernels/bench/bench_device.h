// Which form the benchmarks time: KINEVOX_BENCH_DEVICE=cuda, else the CPU's. kernels/bench/gpu runs both.
#pragma once

#include <cstdlib>
#include <string_view>

#include "kernels/types.h"

namespace kinevox::kernels::bench {

inline Device device() {
    const char* wanted = std::getenv("KINEVOX_BENCH_DEVICE");
    return wanted && std::string_view(wanted) == "cuda" ? Device::kCuda : Device::kCpu;
}

}  // namespace kinevox::kernels::bench
