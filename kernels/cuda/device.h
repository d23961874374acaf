// RAII around the CUDA runtime. A stage owns one stream and its buffers; nothing runs on the default stream.
// Allocations, copies and launches are for the calling thread's GPU, and each thread begins with the first
// one: a stage calls Stream::use() where another thread may enter. The thread keeps that GPU afterwards,
// since choosing one creates CUDA's context there. Host memory that the device copies is pinned, and is only
// written again after the stream was waited for.
#pragma once

#include <cuda_runtime.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace kinevox::kernels::cuda {

// Throws DeviceError with the call, the place and CUDA's own words unless `error` is cudaSuccess.
void check(cudaError_t error, const char* call, const char* file, int line);
#define KINEVOX_CUDA_CHECK(call) ::kinevox::kernels::cuda::check((call), #call, __FILE__, __LINE__)

// For destructors: the thread forgets the error and may work for another GPU.
inline void ignore_error(cudaError_t error) {
    if (error != cudaSuccess) cudaGetLastError();
}

// Makes this GPU the calling thread's, which it also is after require_gpu().
void use_gpu(int gpu);
int gpu_in_use();

// Throws DeviceError that begins with `what` where this GPU cannot be used.
void require_gpu(const char* what, int gpu);

// Empty if the kernels support the GPU's compute capability, else one line.
std::string problem_of_capability(const cudaDeviceProp& properties);

class Stream {
  public:
    explicit Stream(int gpu) : gpu_(gpu) {
        use();
        KINEVOX_CUDA_CHECK(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking));
    }
    ~Stream() {
        ignore_error(cudaSetDevice(gpu_));
        ignore_error(cudaStreamDestroy(stream_));
    }
    Stream(const Stream&) = delete;
    Stream& operator=(const Stream&) = delete;

    int gpu() const { return gpu_; }
    // Makes its GPU the calling thread's.
    void use() const { use_gpu(gpu_); }
    cudaStream_t get() const { return stream_; }
    void wait() const { KINEVOX_CUDA_CHECK(cudaStreamSynchronize(stream_)); }

  private:
    const int gpu_;
    cudaStream_t stream_ = nullptr;
};

// Memory for `size()` elements of a trivially copyable type; resize() only ever grows it and forgets what it
// held. It belongs to the GPU that the thread uses when it grows, and any thread may free it.
template <class T, bool kPinned>
class Buffer {
  public:
    Buffer() = default;
    ~Buffer() { release(); }
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;

    void resize(std::size_t size) {
        size_ = size;
        if (size <= capacity_) return;
        release();
#ifdef KINEVOX_EXACT_BUFFERS  // so that checkers find accesses beyond the end
        const std::size_t wanted = size;
#else
        const std::size_t wanted = size + size / 4;  // sizes change a little from frame to frame
#endif
        gpu_ = gpu_in_use();
        void* memory = nullptr;
        if constexpr (kPinned) {
            KINEVOX_CUDA_CHECK(cudaMallocHost(&memory, wanted * sizeof(T)));
        } else {
            KINEVOX_CUDA_CHECK(cudaMalloc(&memory, wanted * sizeof(T)));
        }
        data_ = static_cast<T*>(memory);
        capacity_ = wanted;
    }

    T* data() const {
        return data_;
    }
    std::size_t size() const {
        return size_;
    }
    T& operator[](std::size_t n) const requires kPinned {
        return data_[n];
    }

  private:
    void release() {         // both wait for work that may still use the memory
        if (!data_) return;  // which would create a context on a fresh thread's GPU
        ignore_error(cudaSetDevice(gpu_));
        if constexpr (kPinned) {
            ignore_error(cudaFreeHost(data_));
        } else {
            ignore_error(cudaFree(data_));
        }
        data_ = nullptr;
        capacity_ = 0;
    }

    T* data_ = nullptr;
    std::size_t size_ = 0, capacity_ = 0;
    int gpu_ = 0;  // of data_
};

template <class T>
using DeviceBuffer = Buffer<T, false>;
template <class T>
using PinnedBuffer = Buffer<T, true>;

template <class T>
void upload(const Stream& stream, T* device, const T* pinned, std::size_t count) {
    if (count == 0) return;
    KINEVOX_CUDA_CHECK(
        cudaMemcpyAsync(device, pinned, count * sizeof(T), cudaMemcpyHostToDevice, stream.get()));
}

// Makes `device` as long as `pinned` and copies it.
template <class T>
void upload(const Stream& stream, DeviceBuffer<T>& device, const PinnedBuffer<T>& pinned) {
    device.resize(pinned.size());
    upload(stream, device.data(), pinned.data(), pinned.size());
}

// The result is there after stream.wait().
template <class T>
void download(const Stream& stream, T* pinned, const T* device, std::size_t count) {
    if (count == 0) return;
    KINEVOX_CUDA_CHECK(
        cudaMemcpyAsync(pinned, device, count * sizeof(T), cudaMemcpyDeviceToHost, stream.get()));
}

template <class T>
void fill_bytes(const Stream& stream, T* device, int value, std::size_t count) {
    if (count == 0) return;
    KINEVOX_CUDA_CHECK(cudaMemsetAsync(device, value, count * sizeof(T), stream.get()));
}

// Pieces of different types that one copy brings to the device: clear(), reserve() each, place(), fill what
// host() returns, upload(). Where they are on the device is stated by device(). The memory never shrinks.
class PackedUpload {
  public:
    void clear() { bytes_ = 0; }
    // Returns where the piece begins.
    template <class T>
    std::size_t reserve(std::size_t count) {
        constexpr std::size_t kAligned = 16;
        const std::size_t begin = bytes_;
        bytes_ += (count * sizeof(T) + kAligned - 1) / kAligned * kAligned;
        return begin;
    }
    // `more`: bytes behind the pieces, on the device alone. `spare`: bytes by which the pieces may grow later
    // and still stay where they are.
    void place(std::size_t more = 0, std::size_t spare = 0) {
        host_.resize(bytes_ + spare);
        device_.resize(bytes_ + spare + more);
    }
    template <class T>
    T* host(std::size_t begin) const {
        return reinterpret_cast<T*>(host_.data() + begin);
    }
    template <class T>
    T* device(std::size_t begin) const {
        return reinterpret_cast<T*>(device_.data() + begin);
    }
    std::size_t size() const { return bytes_; }
    void upload(const Stream& stream) const { cuda::upload(stream, device_.data(), host_.data(), bytes_); }

  private:
    std::size_t bytes_ = 0;
    PinnedBuffer<std::uint8_t> host_;
    DeviceBuffer<std::uint8_t> device_;
};

// Kernels that are often queued with the same arguments, as one launch.
class KernelGraph {
  public:
    KernelGraph() = default;
    ~KernelGraph() { release(); }
    KernelGraph(const KernelGraph&) = delete;
    KernelGraph& operator=(const KernelGraph&) = delete;

    // Queues what queue() does. `key`: all that the arguments depend on. To make a graph takes as long as to
    // queue its kernels many times, so that one is made for the second call in a row with the same key.
    template <class F>
    void run(const Stream& stream, const std::vector<std::intptr_t>& key, const F& queue) {
        if (key != key_) {
            release();
            key_ = key;
            return queue();
        }
        if (!graph_) record(stream, queue);
        gpu_ = stream.gpu();
        KINEVOX_CUDA_CHECK(cudaGraphLaunch(graph_, stream.get()));
    }

  private:
    template <class F>
    void record(const Stream& stream, const F& queue) {
        cudaGraph_t recorded = nullptr;
        // Other threads may do as they like meanwhile.
        KINEVOX_CUDA_CHECK(cudaStreamBeginCapture(stream.get(), cudaStreamCaptureModeThreadLocal));
        try {
            queue();
        } catch (...) {
            const cudaError_t ended = cudaStreamEndCapture(stream.get(), &recorded);
            ignore_error(ended == cudaSuccess ? cudaGraphDestroy(recorded) : ended);
            throw;
        }
        KINEVOX_CUDA_CHECK(cudaStreamEndCapture(stream.get(), &recorded));
        const cudaError_t error = cudaGraphInstantiate(&graph_, recorded, 0);
        cudaGraphDestroy(recorded);
        KINEVOX_CUDA_CHECK(error);
    }
    void release() {
        if (!graph_) return;
        ignore_error(cudaSetDevice(gpu_));
        ignore_error(cudaGraphExecDestroy(graph_));
        graph_ = nullptr;
    }

    std::vector<std::intptr_t> key_;
    cudaGraphExec_t graph_ = nullptr;
    int gpu_ = 0;  // of graph_
};

inline constexpr int kThreads = 256;  // per block, where nothing asks for another number

// Enough blocks of `threads` for `count` threads along x; `rows` along y (a view each, for instance).
inline dim3 blocks(std::size_t count, int rows = 1, int threads = kThreads) {
    return dim3(static_cast<unsigned>((count + threads - 1) / threads), static_cast<unsigned>(rows));
}

#ifdef __CUDACC__
// This thread's place along x, and the number of threads there.
__device__ inline int thread_index() {
    return static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
}
__device__ inline int thread_count() {
    return static_cast<int>(gridDim.x * blockDim.x);
}

// The sum of the values of this lane and of those before it in the warp.
__device__ inline int inclusive_sum_of_warp(int value) {
    const int lane = static_cast<int>(threadIdx.x) % 32;
    for (int step = 1; step < 32; step *= 2) {
        const int before = __shfl_up_sync(0xffffffffu, value, step);
        if (lane >= step) value += before;
    }
    return value;
}

// The same over a block of 1024 threads. `warp_sums`, 32 shared integers, then ends with the sum of the
// block.
__device__ inline int inclusive_sum_of_block(int value, int* warp_sums) {
    const int lane = static_cast<int>(threadIdx.x) % 32, warp = static_cast<int>(threadIdx.x) / 32;
    const int sum = inclusive_sum_of_warp(value);
    if (lane == 31) warp_sums[warp] = sum;
    __syncthreads();
    if (warp == 0) warp_sums[lane] = inclusive_sum_of_warp(warp_sums[lane]);
    __syncthreads();
    return warp > 0 ? warp_sums[warp - 1] + sum : sum;
}
#endif

}  // namespace kinevox::kernels::cuda
