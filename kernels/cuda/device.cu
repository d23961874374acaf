#include <string>

#include "kernels/cuda/device.h"
#include "kernels/cuda/forms.h"
#include "kernels/device_error.h"

namespace kinevox::kernels {
namespace cuda {

void check(cudaError_t error, const char* call, const char* file, int line) {
    if (error == cudaSuccess) return;
    cudaGetLastError();  // the thread keeps it otherwise, also for its work on another GPU
    throw DeviceError(std::string("CUDA: ") + cudaGetErrorString(error) + " in " + call + " (" + file + ":" +
                      std::to_string(line) + ")");
}

void require_gpu(const char* what, int gpu) {
    if (const std::string problem = cuda_problem(gpu); !problem.empty())
        throw DeviceError(std::string(what) + ": " + problem + "; use device cpu");
    use_gpu(gpu);
}

void use_gpu(int gpu) {
    KINEVOX_CUDA_CHECK(cudaSetDevice(gpu));
}

int gpu_in_use() {
    int gpu = 0;
    KINEVOX_CUDA_CHECK(cudaGetDevice(&gpu));
    return gpu;
}

std::string problem_of_capability(const cudaDeviceProp& properties) {
    if (properties.major * 10 + properties.minor >= 75) return {};
    return std::string(properties.name) + " has compute capability " + std::to_string(properties.major) +
           "." + std::to_string(properties.minor) + ", 7.5 or above is needed";
}

}  // namespace cuda

std::string cuda_problem(int gpu) {
    int count = 0;
    const cudaError_t error = cudaGetDeviceCount(&count);
    if (error != cudaSuccess) {
        cudaGetLastError();  // the next call shall not report this one
        return std::string("no CUDA device can be used (") + cudaGetErrorString(error) + ")";
    }
    if (count == 0) return "this machine has no CUDA device";
    if (gpu >= count)
        return "there is no " + name_of(Device::cuda(gpu)) + "; this machine has " +
               (count == 1 ? "one GPU, cuda:0"
                           : std::to_string(count) + " GPUs, cuda:0 to " + name_of(Device::cuda(count - 1))) +
               " (`kinevox devices` lists them)";
    cudaDeviceProp properties{};
    if (cudaGetDeviceProperties(&properties, gpu) != cudaSuccess) {
        cudaGetLastError();
        return name_of(Device::cuda(gpu)) + " does not answer";
    }
    return cuda::problem_of_capability(properties);
}

std::string cuda_device_name(int gpu) {
    cudaDeviceProp properties{};
    if (!cuda_problem(gpu).empty() || cudaGetDeviceProperties(&properties, gpu) != cudaSuccess) return {};
    return properties.name;
}

DeviceMemory cuda_memory(int gpu) {
    std::size_t free_bytes = 0, total_bytes = 0;
    if (cudaSetDevice(gpu) != cudaSuccess || cudaMemGetInfo(&free_bytes, &total_bytes) != cudaSuccess) {
        cudaGetLastError();
        return {};
    }
    return {total_bytes - free_bytes, total_bytes};
}

}  // namespace kinevox::kernels
