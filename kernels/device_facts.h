// What this machine can compute with, for `kinevox devices`.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "kernels/device.h"

namespace kinevox::kernels {

struct CpuFacts {
    std::string model;                          // "AMD EPYC 7302"; empty if the system does not report it
    int logical_cores = 0;                      // that this process may use
    std::vector<std::string> instruction_sets;  // that the kernels use beyond the compiler's default
};

struct GpuFacts {
    Device device;
    std::string name;        // "NVIDIA T4"
    std::string pci_bus_id;  // "0000:01:00.0", as nvidia-smi reports it
    int capability_major = 0, capability_minor = 0;
    int multiprocessors = 0;
    std::uint64_t total_bytes = 0;
    std::uint64_t free_bytes = 0;  // 0 if it cannot be used
    std::string problem, remedy;   // one line each; empty if it can be used
    bool usable() const { return problem.empty(); }
};

struct CudaFacts {
    std::string driver_version;   // of CUDA, "12.4", the newest that the driver supports; empty: no driver
    std::string runtime_version;  // of CUDA, which this program is built with; empty: built without
    std::string problem, remedy;  // why there is no GPU, one line each; empty if there is one
    std::vector<GpuFacts> gpus;   // in CUDA's order, cuda:0 first
};

CpuFacts cpu_facts();

// Executes a small kernel on each GPU, which creates CUDA's context there.
CudaFacts cuda_facts();

// The usable GPU with the most multiprocessors, among equal ones that with the most free memory; else the
// CPU.
Device recommended_device(const CudaFacts& cuda);

}  // namespace kinevox::kernels
