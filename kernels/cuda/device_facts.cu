// What CUDA's runtime reports about the machine.
#include <string>

#include "kernels/cuda/device.h"
#include "kernels/cuda/forms.h"
#include "kernels/device_error.h"

namespace kinevox::kernels {
namespace cuda {
namespace {

constexpr int kProbeValue = 4711;

__global__ void probe_device(int* out) {
    *out = kProbeValue;
}

// "12.4" of 12040.
std::string version_text(int version) {
    return std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
}

// Empty if the GPU executes a kernel of this program, else what went wrong. Afterwards the GPU is the
// thread's.
std::string failure_of_probe(int gpu, cudaError_t& error) {
    const auto in_words = [&](const char* what) {
        return std::string(what) + " (" + cudaGetErrorString(error) + ")";
    };
    if (error = cudaSetDevice(gpu); error != cudaSuccess) {
        cudaGetLastError();
        return in_words("it does not answer");
    }
    try {
        const Stream stream(gpu);
        DeviceBuffer<int> value;
        PinnedBuffer<int> on_host;
        value.resize(1);
        on_host.resize(1);
        on_host[0] = 0;
        probe_device<<<1, 1, 0, stream.get()>>>(value.data());
        if (error = cudaGetLastError(); error != cudaSuccess) return in_words("it cannot execute a kernel");
        download(stream, on_host.data(), value.data(), 1);
        stream.wait();
        return on_host[0] == kProbeValue ? "" : "it computes wrong results";
    } catch (const DeviceError& failure) {
        return failure.what();
    }
}

void judge(const cudaDeviceProp& properties, GpuFacts& facts) {
    const std::string capability = std::to_string(properties.major) + "." + std::to_string(properties.minor);
    if (facts.problem = problem_of_capability(properties); !facts.problem.empty()) {
        facts.remedy = "choose another device";
        return;
    }
    cudaError_t error = cudaSuccess;
    facts.problem = failure_of_probe(facts.device.index(), error);
    if (facts.problem.empty()) {
        const DeviceMemory memory = cuda_memory(facts.device.index());
        facts.free_bytes = memory.total_bytes - memory.used_bytes;
    } else if (error == cudaErrorNoKernelImageForDevice) {
        facts.problem = "this program has no kernels for compute capability " + capability;
        facts.remedy = "configure with -DCMAKE_CUDA_ARCHITECTURES=" + std::to_string(properties.major) +
                       std::to_string(properties.minor) + " and build again";
    } else if (error == cudaErrorUnsupportedPtxVersion) {
        facts.problem =
            "the driver cannot translate this program's kernels for compute capability " + capability;
        facts.remedy = "install a driver for CUDA " + version_text(CUDART_VERSION) + " or later";
    } else {
        facts.remedy = "end the programs that use it (nvidia-smi lists them), else restart the machine";
    }
}

GpuFacts facts_of(int gpu) {
    GpuFacts facts;
    facts.device = Device::cuda(gpu);
    cudaDeviceProp properties{};
    if (const cudaError_t error = cudaGetDeviceProperties(&properties, gpu); error != cudaSuccess) {
        facts.problem = std::string("it does not answer (") + cudaGetErrorString(error) + ")";
        facts.remedy = "restart the machine";
        return facts;
    }
    char bus_id[32] = {};
    if (cudaDeviceGetPCIBusId(bus_id, sizeof bus_id, gpu) == cudaSuccess) facts.pci_bus_id = bus_id;
    facts.name = properties.name;
    facts.capability_major = properties.major, facts.capability_minor = properties.minor;
    facts.multiprocessors = properties.multiProcessorCount;
    facts.total_bytes = properties.totalGlobalMem;
    judge(properties, facts);
    return facts;
}

}  // namespace
}  // namespace cuda

CudaFacts cuda_facts_of_runtime() {
    CudaFacts facts;
    int driver = 0, runtime = 0, count = 0;
    if (cudaDriverGetVersion(&driver) == cudaSuccess && driver > 0)
        facts.driver_version = cuda::version_text(driver);
    if (cudaRuntimeGetVersion(&runtime) == cudaSuccess) facts.runtime_version = cuda::version_text(runtime);
    const cudaError_t error = cudaGetDeviceCount(&count);
    if (facts.driver_version.empty()) {
        facts.problem = "NVIDIA's driver is not loaded";
        facts.remedy = "with an NVIDIA GPU, install nvidia-driver and restart the machine";
    } else if (error == cudaErrorInsufficientDriver) {
        facts.problem = "NVIDIA's driver supports CUDA " + facts.driver_version +
                        " at most, this program needs " + facts.runtime_version;
        facts.remedy = "install a newer driver";
    } else if (error == cudaErrorNoDevice || (error == cudaSuccess && count == 0)) {
        facts.problem = "NVIDIA's driver finds no GPU";
        facts.remedy = "check CUDA_VISIBLE_DEVICES and `nvidia-smi`";
    } else if (error != cudaSuccess) {
        facts.problem = std::string("CUDA does not start (") + cudaGetErrorString(error) + ")";
        facts.remedy = "check the driver (`kinevox doctor`), then restart the machine";
    }
    cudaGetLastError();  // the next call shall not report this one
    if (facts.problem.empty())
        for (int gpu = 0; gpu < count; ++gpu) facts.gpus.push_back(cuda::facts_of(gpu));
    return facts;
}

}  // namespace kinevox::kernels
