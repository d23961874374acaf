#include "kernels/device_facts.h"

#include <tuple>

#include "kernels/cuda/forms.h"

namespace kinevox::kernels {

CudaFacts cuda_facts() {
#ifdef KINEVOX_HAVE_CUDA
    return cuda_facts_of_runtime();
#else
    CudaFacts facts;
    facts.problem = "this program was built without a CUDA compiler";
    facts.remedy = "build where nvcc is found";
    return facts;
#endif
}

Device recommended_device(const CudaFacts& cuda) {
    const GpuFacts* best = nullptr;
    const auto rank = [](const GpuFacts& gpu) { return std::tuple(gpu.multiprocessors, gpu.free_bytes); };
    for (const GpuFacts& gpu : cuda.gpus)
        if (gpu.usable() && (!best || rank(gpu) > rank(*best))) best = &gpu;
    return best ? best->device : Device::kCpu;
}

}  // namespace kinevox::kernels
