// The GPU whose forms the kernel tests compare with the CPU's.
#pragma once

#include <cstdlib>
#include <stdexcept>
#include <string>

#include "kernels/device.h"

namespace kinevox::kernels::testing {

// That of KINEVOX_TEST_DEVICE, cuda:1 for instance, else the first one.
inline Device tested_gpu() {
    const char* const wanted = std::getenv("KINEVOX_TEST_DEVICE");
    const auto device = device_of_name(wanted ? wanted : "cuda");
    if (!device || !device->is_cuda()) throw std::invalid_argument("KINEVOX_TEST_DEVICE: use cuda or cuda:N");
    return *device;
}

}  // namespace kinevox::kernels::testing
