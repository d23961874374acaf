// Small kernels, each with one fault that is easily made. Each has a correct form, too.
#pragma once

#include <span>
#include <vector>

namespace planted_faults {

struct Fault {
    const char* name;
    std::vector<int> (*run)(bool faulty);  // the kernel's results
};

std::span<const Fault> all();

}  // namespace planted_faults
