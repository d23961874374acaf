// CUDA's runtime: devices, streams, copies, graphs. One lock for all, since there is one block runner.
#include <chrono>
#include <cstdio>
#include <functional>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/cuda/emulator/access_checker.h"
#include "tests/cuda/emulator/block_runner.h"
#include "tests/cuda/emulator/calls.h"
#include "tests/cuda/emulator/cuda_runtime.h"
#include "tests/cuda/emulator/device_memory.h"
#include "tests/cuda/emulator/devices.h"
#include "tests/cuda/emulator/settings.h"

namespace cuda_emulator {

using Work = std::function<void()>;
struct Graph {
    int device = 0;
    std::vector<Work> work;
};
struct Stream {
    int device = 0;
    std::vector<Work> work;  // deferred
    std::unique_ptr<Graph> capture;
};

namespace {

std::recursive_mutex mutex;
DeviceMemory memory;
std::vector<cudaStream_t> streams;
Calls calls;
thread_local cudaError_t last_error = cudaSuccess;
thread_local int current_gpu = 0;
std::set<int> with_context, broken;

cudaError_t failed(cudaError_t error) {
    return last_error = error;
}

// What each call for a GPU begins with: its context is made where there is none, and it may be broken.
cudaError_t enter_device() {
    with_context.insert(current_gpu);
    return broken.contains(current_gpu) ? failed(cudaErrorIllegalAddress) : cudaSuccess;
}
cudaError_t enter_stream(const Stream& stream) {
    require_current(stream.device, "a stream");
    return enter_device();
}
// Pinned memory may be that of another GPU in CUDA; here, no stage shares any.
void require_current_memory(const void* at) {
    if (const int gpu = memory.gpu_of(at); gpu >= 0) require_current(gpu, "memory");
}

void drain(Stream& stream) {
    if (stream.work.empty()) return;
    memory.set_open(true, stream.device);
    access::gpu_runs(stream.device);
    for (const Work& work : stream.work) work();
    stream.work.clear();
    memory.check_gaps(stream.device);
    memory.set_open(false, stream.device);
}

void submit(cudaStream_t stream, Work work) {
    if (stream->capture) {
        stream->capture->work.push_back(std::move(work));
        return;
    }
    stream->work.push_back(std::move(work));
    if (!settings().deferred) drain(*stream);
}

struct KernelTimes {
    long launches = 0;
    double blocks = 0, ms = 0;
};
void print_profile(const std::map<std::string, KernelTimes>& profile) {
    std::fprintf(stderr, "%-28s %9s %11s %10s\n", "kernel", "launches", "blocks", "ms");
    for (const auto& [name, times] : profile)
        std::fprintf(stderr, "%-28s %9ld %11.0f %10.1f\n", name.c_str(), times.launches, times.blocks,
                     times.ms);
}
std::map<std::string, KernelTimes> profile;

void run_kernel(const Launch& launch, const char* name, const Call& call, std::size_t bytes) {
    const auto begin = std::chrono::steady_clock::now();
    block_runner().run(launch, name, call, bytes);
    if (!settings().profile) return;
    if (profile.empty()) std::atexit([] { print_profile(profile); });
    KernelTimes& times = profile[name];
    ++times.launches;
    times.blocks += static_cast<double>(launch.grid.x) * launch.grid.y * launch.grid.z;
    times.ms += std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
}

// Whether a copy's ends are where its kind says; warns of host memory that is not pinned.
bool valid_copy(const void* to, const void* from, std::size_t bytes, cudaMemcpyKind kind) {
    require_current_memory(to);
    require_current_memory(from);
    const auto at_to = memory.kind_of(to, bytes), at_from = memory.kind_of(from, bytes);
    using Kind = DeviceMemory::Kind;
    const bool to_device = kind != cudaMemcpyDeviceToHost, from_device = kind != cudaMemcpyHostToDevice;
    if ((at_to == Kind::kDevice) != to_device || (at_from == Kind::kDevice) != from_device) return false;
    if (at_to == Kind::kBeyond || at_from == Kind::kBeyond) return false;
    if (at_to == Kind::kHost || at_from == Kind::kHost)
        std::fprintf(stderr, "CUDA emulator: a copy of %zu bytes with memory that is not pinned\n", bytes);
    return true;
}

}  // namespace

int current_device() {
    return current_gpu;
}

std::vector<int> take_devices_with_context() {
    const std::lock_guard lock(mutex);
    const std::set<int> taken = std::exchange(with_context, {});
    return {taken.begin(), taken.end()};
}

void break_device(int device) {
    const std::lock_guard lock(mutex);
    broken.insert(device);
}
void repair_devices() {
    const std::lock_guard lock(mutex);
    broken.clear();
}

void require_current(int device, const char* what) {
    if (device != current_gpu)
        fail(std::string(what) + " of cuda:" + std::to_string(device) +
             " is used while the thread's GPU is cuda:" + std::to_string(current_gpu));
}

Calls take_calls() {
    const std::lock_guard lock(mutex);
    return std::exchange(calls, {});
}

void enqueue(const Launch& launch, const char* name, std::shared_ptr<const Call> call, std::size_t bytes) {
    const std::lock_guard lock(mutex);
    const dim3 &grid = launch.grid, &block = launch.block;
    const auto threads = std::uint64_t{block.x} * block.y * block.z;
    const bool valid = threads > 0 && threads <= 1024 && block.z <= 64 && grid.x > 0 && grid.y > 0 &&
                       grid.z > 0 && grid.x <= 0x7fffffffu && grid.y <= 65535 && grid.z <= 65535;
    if (!valid) {
        failed(cudaErrorInvalidConfiguration);
        return;
    }
    if (launch.stream == nullptr) fail(std::string(name) + " runs on the default stream");
    if (enter_stream(*launch.stream) != cudaSuccess) return;
    ++calls.launches;
    submit(launch.stream, [launch, name, call, bytes] { run_kernel(launch, name, *call, bytes); });
}

}  // namespace cuda_emulator

using namespace cuda_emulator;

cudaError_t cudaStreamCreateWithFlags(cudaStream_t* stream, unsigned) {
    const std::lock_guard lock(mutex);
    if (const cudaError_t error = enter_device(); error != cudaSuccess) return error;
    *stream = new Stream{.device = current_gpu};
    streams.push_back(*stream);
    return cudaSuccess;
}
cudaError_t cudaStreamDestroy(cudaStream_t stream) {
    const std::lock_guard lock(mutex);
    if (!stream) return failed(cudaErrorInvalidValue);
    const cudaError_t error = enter_stream(*stream);
    if (error == cudaSuccess) drain(*stream);
    std::erase(streams, stream);
    delete stream;
    return error;
}
cudaError_t cudaStreamSynchronize(cudaStream_t stream) {
    const std::lock_guard lock(mutex);
    if (const cudaError_t error = enter_stream(*stream); error != cudaSuccess) return error;
    if (stream->capture) return failed(cudaErrorStreamCaptureUnsupported);
    ++calls.waits;
    drain(*stream);
    return std::exchange(last_error, cudaSuccess);
}

static cudaError_t allocate(void** out, std::size_t bytes, bool device) {
    const std::lock_guard lock(mutex);
    *out = nullptr;
    if (const cudaError_t error = enter_device(); error != cudaSuccess) return error;
    if (bytes == 0) return cudaSuccess;
    ++calls.allocations;
    *out = memory.allocate(bytes, device, current_gpu);
    return *out ? cudaSuccess : failed(cudaErrorMemoryAllocation);
}
static cudaError_t release(void* at, bool device) {
    const std::lock_guard lock(mutex);
    const cudaError_t error = enter_device();
    if (!at) return error;
    require_current_memory(at);
    for (const cudaStream_t stream : streams)  // as CUDA does
        if (stream->device == current_gpu && error == cudaSuccess) drain(*stream);
    const bool released = memory.release(at, device);
    return error != cudaSuccess || released ? error : failed(cudaErrorInvalidValue);
}
cudaError_t cudaMalloc(void** out, std::size_t bytes) {
    return allocate(out, bytes, true);
}
cudaError_t cudaMallocHost(void** out, std::size_t bytes) {
    return allocate(out, bytes, false);
}
cudaError_t cudaFree(void* at) {
    return release(at, true);
}
cudaError_t cudaFreeHost(void* at) {
    return release(at, false);
}

cudaError_t cudaMemcpy2DAsync(void* to, std::size_t to_pitch, const void* from, std::size_t from_pitch,
                              std::size_t bytes, std::size_t rows, cudaMemcpyKind kind, cudaStream_t stream) {
    const std::lock_guard lock(mutex);
    if (const cudaError_t error = enter_stream(*stream); error != cudaSuccess) return error;
    if (rows == 0 || bytes == 0) return cudaSuccess;
    if (bytes > to_pitch || bytes > from_pitch) return failed(cudaErrorInvalidValue);
    const std::size_t to_span = (rows - 1) * to_pitch + bytes, from_span = (rows - 1) * from_pitch + bytes;
    auto* target = static_cast<unsigned char*>(to);
    const auto* source = static_cast<const unsigned char*>(from);
    if (!valid_copy(target + to_span - bytes, source + from_span - bytes, bytes, kind) ||
        !valid_copy(target, source, bytes, kind))
        return failed(cudaErrorInvalidValue);
    if (kind == cudaMemcpyHostToDevice) {
        ++calls.uploads;
        calls.uploaded_bytes += rows * bytes;
    } else if (kind == cudaMemcpyDeviceToHost) {
        ++calls.downloads;
        calls.downloaded_bytes += rows * bytes;
    }
    submit(stream, [=] {
        for (std::size_t row = 0; row < rows; ++row) {
            access::written(target + row * to_pitch, bytes);
            std::memcpy(target + row * to_pitch, source + row * from_pitch, bytes);
        }
    });
    return cudaSuccess;
}
cudaError_t cudaMemcpyAsync(void* to, const void* from, std::size_t bytes, cudaMemcpyKind kind,
                            cudaStream_t stream) {
    return cudaMemcpy2DAsync(to, bytes, from, bytes, bytes, 1, kind, stream);
}
cudaError_t cudaMemsetAsync(void* to, int value, std::size_t bytes, cudaStream_t stream) {
    const std::lock_guard lock(mutex);
    if (const cudaError_t error = enter_stream(*stream); error != cudaSuccess) return error;
    require_current_memory(to);
    if (memory.kind_of(to, bytes) != DeviceMemory::Kind::kDevice) return failed(cudaErrorInvalidValue);
    ++calls.memsets;
    submit(stream, [=] {
        access::written(to, bytes);
        std::memset(to, value, bytes);
    });
    return cudaSuccess;
}

cudaError_t cudaStreamBeginCapture(cudaStream_t stream, cudaStreamCaptureMode) {
    const std::lock_guard lock(mutex);
    if (const cudaError_t error = enter_stream(*stream); error != cudaSuccess) return error;
    if (stream->capture) return failed(cudaErrorStreamCaptureUnsupported);
    stream->capture = std::make_unique<Graph>(Graph{.device = stream->device, .work = {}});
    return cudaSuccess;
}
cudaError_t cudaStreamEndCapture(cudaStream_t stream, cudaGraph_t* graph) {
    const std::lock_guard lock(mutex);
    if (!stream->capture) return failed(cudaErrorInvalidValue);
    *graph = stream->capture.release();
    return cudaSuccess;
}
cudaError_t cudaGraphInstantiate(cudaGraphExec_t* executable, cudaGraph_t graph, unsigned long long) {
    *executable = new Graph(*graph);
    return cudaSuccess;
}
cudaError_t cudaGraphLaunch(cudaGraphExec_t executable, cudaStream_t stream) {
    const std::lock_guard lock(mutex);
    require_current(executable->device, "a graph");
    if (const cudaError_t error = enter_stream(*stream); error != cudaSuccess) return error;
    ++calls.launches;
    for (const Work& work : executable->work) submit(stream, work);
    return cudaSuccess;
}
cudaError_t cudaGraphDestroy(cudaGraph_t graph) {
    delete graph;
    return cudaSuccess;
}
cudaError_t cudaGraphExecDestroy(cudaGraphExec_t executable) {
    require_current(executable->device, "a graph");
    delete executable;
    return cudaSuccess;
}

cudaError_t cudaGetLastError() {
    return std::exchange(last_error, cudaSuccess);
}
const char* cudaGetErrorString(cudaError_t error) {
    switch (error) {
        case cudaSuccess:
            return "no error";
        case cudaErrorInvalidValue:
            return "invalid argument";
        case cudaErrorMemoryAllocation:
            return "out of memory";
        case cudaErrorInvalidConfiguration:
            return "invalid configuration argument";
        case cudaErrorInsufficientDriver:
            return "CUDA driver version is insufficient for CUDA runtime version";
        case cudaErrorNoDevice:
            return "no CUDA-capable device is detected";
        case cudaErrorInvalidDevice:
            return "invalid device ordinal";
        case cudaErrorNoKernelImageForDevice:
            return "no kernel image is available for execution on the device";
        case cudaErrorUnsupportedPtxVersion:
            return "the provided PTX was compiled with an unsupported toolchain.";
        case cudaErrorIllegalAddress:
            return "an illegal memory access was encountered";
        case cudaErrorStreamCaptureUnsupported:
            return "operation not permitted when stream is capturing";
    }
    return "unrecognized error code";
}
static constexpr std::size_t kMemoryBytes = std::size_t{8} << 30;  // of each GPU
static bool exists(int device) {
    return device >= 0 && device < settings().devices;
}

cudaError_t cudaGetDeviceCount(int* count) {
    *count = settings().devices;
    return *count > 0 ? cudaSuccess : failed(cudaErrorNoDevice);
}
cudaError_t cudaGetDevice(int* device) {
    *device = current_gpu;
    return cudaSuccess;
}
cudaError_t cudaSetDevice(int device) {
    const std::lock_guard lock(mutex);
    if (!exists(device)) return failed(cudaErrorInvalidDevice);
    current_gpu = device;
    return enter_device();
}
cudaError_t cudaGetDeviceProperties(cudaDeviceProp* properties, int device) {
    if (!exists(device)) return failed(cudaErrorInvalidDevice);
    *properties = {"CUDA emulator", 9, 0, 1, kMemoryBytes};
    return cudaSuccess;
}
cudaError_t cudaDeviceGetPCIBusId(char* id, int bytes, int device) {
    if (!exists(device)) return failed(cudaErrorInvalidDevice);
    std::snprintf(id, static_cast<std::size_t>(bytes), "0000:%02x:00.0", 1 + device);
    return cudaSuccess;
}
cudaError_t cudaDriverGetVersion(int* version) {
    *version = settings().devices > 0 ? CUDART_VERSION : 0;
    return cudaSuccess;
}
cudaError_t cudaRuntimeGetVersion(int* version) {
    *version = CUDART_VERSION;
    return cudaSuccess;
}
cudaError_t cudaMemGetInfo(std::size_t* free_bytes, std::size_t* total_bytes) {
    const std::lock_guard lock(mutex);
    if (const cudaError_t error = enter_device(); error != cudaSuccess) return error;
    *total_bytes = kMemoryBytes;
    *free_bytes = kMemoryBytes - memory.bytes_on(current_gpu);
    return cudaSuccess;
}
