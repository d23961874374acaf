// What `kinevox devices` prints.
#pragma once

#include <string>

#include "kernels/device_facts.h"

namespace kinevox {

// A table with a row per device, and the reason where no GPU is listed.
std::string device_table(const kernels::CpuFacts& cpu, const kernels::CudaFacts& cuda);

// One object, one line.
std::string device_json(const kernels::CpuFacts& cpu, const kernels::CudaFacts& cuda);

}  // namespace kinevox
