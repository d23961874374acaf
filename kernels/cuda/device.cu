#include <string>

#include "kernels/cuda/device.h"
#include "kernels/cuda/forms.h"
#include "kernels/device_error.h"

namespace kinevox::kernels {
namespace cuda {
namespace {

constexpr int kScanThreads = 1024;

// One block walks along the list: it is a few thousand entries long, so that more blocks would not pay.
__global__ void scan_kernel(const int* in, int* out, int count) {
    __shared__ int warp_sums[32];
    __shared__ int carry;
    const int thread = threadIdx.x;
    if (thread == 0) carry = 0;
    __syncthreads();
    for (int base = 0; base < count; base += kScanThreads) {
        const int n = base + thread;
        const int value = n < count ? in[n] : 0;
        const int before = carry + inclusive_sum_of_block(value, warp_sums) - value;
        if (n < count) out[n] = before;
        __syncthreads();  // all have read `carry` and `warp_sums`
        if (thread == kScanThreads - 1) carry = before + value;
        __syncthreads();
    }
    if (thread == 0) out[count] = carry;
}

}  // namespace

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

void exclusive_scan(const Stream& stream, const int* in, int* out, int count) {
    scan_kernel<<<1, kScanThreads, 0, stream.get()>>>(in, out, count);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
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
