#include <string>

#include "kernels/cuda/device.h"
#include "kernels/cuda/forms.h"
#include "kernels/device_error.h"

namespace kinevox::kernels {
namespace cuda {

void check(cudaError_t error, const char* call, const char* file, int line) {
    if (error == cudaSuccess) return;
    throw DeviceError(std::string("CUDA: ") + cudaGetErrorString(error) + " in " + call + " (" + file + ":" +
                      std::to_string(line) + ")");
}

void require_gpu(const char* what) {
    if (const std::string problem = cuda_problem(); !problem.empty()) {
        throw DeviceError(std::string(what) + ": " + problem + "; use device cpu");
    }
}

}  // namespace cuda

std::string cuda_problem() {
    int count = 0;
    const cudaError_t error = cudaGetDeviceCount(&count);
    if (error != cudaSuccess) {
        cudaGetLastError();  // the next call shall not report this one
        return std::string("no CUDA device can be used (") + cudaGetErrorString(error) + ")";
    }
    if (count == 0) return "this machine has no CUDA device";
    cudaDeviceProp properties{};
    if (cudaGetDeviceProperties(&properties, 0) != cudaSuccess) return "the CUDA device does not answer";
    if (properties.major * 10 + properties.minor < 75) {
        return std::string(properties.name) + " is older than compute capability 7.5";
    }
    return {};
}

std::string cuda_device_name() {
    cudaDeviceProp properties{};
    if (!cuda_problem().empty() || cudaGetDeviceProperties(&properties, 0) != cudaSuccess) return {};
    return properties.name;
}

DeviceMemory cuda_memory() {
    std::size_t free_bytes = 0, total_bytes = 0;
    if (cudaMemGetInfo(&free_bytes, &total_bytes) != cudaSuccess) return {};
    return {total_bytes - free_bytes, total_bytes};
}

}  // namespace kinevox::kernels
