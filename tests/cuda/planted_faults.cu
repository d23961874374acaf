#include <cuda_runtime.h>

#include <cstdlib>

#include "tests/cuda/planted_faults.h"

namespace planted_faults {
namespace {

constexpr int kThreads = 64, kBlocks = 4, kCount = kThreads * kBlocks;
constexpr unsigned kAllLanes = 0xffffffffu;

// Numbers in device and pinned memory, and a stream for both. Its GPU becomes the thread's.
class Numbers {
  public:
    explicit Numbers(int count, int gpu = 0) : count_(count), gpu_(gpu) {
        cudaSetDevice(gpu);
        cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking);
        cudaMalloc(reinterpret_cast<void**>(&device), bytes());
        cudaMallocHost(reinterpret_cast<void**>(&pinned), bytes());
        for (int n = 0; n < count; ++n) pinned[n] = 7 * n % 101;
    }
    ~Numbers() {
        cudaSetDevice(gpu_);
        cudaFree(device);
        cudaFreeHost(pinned);
        cudaStreamDestroy(stream_);
    }
    Numbers(const Numbers&) = delete;
    Numbers& operator=(const Numbers&) = delete;

    void upload() { cudaMemcpyAsync(device, pinned, bytes(), cudaMemcpyHostToDevice, stream_); }
    void download() { cudaMemcpyAsync(pinned, device, bytes(), cudaMemcpyDeviceToHost, stream_); }
    void clear() { cudaMemsetAsync(device, 0, bytes(), stream_); }
    void wait() { cudaStreamSynchronize(stream_); }
    cudaStream_t stream() const { return stream_; }
    std::vector<int> values() const { return {pinned, pinned + count_}; }

    int* device = nullptr;
    int* pinned = nullptr;

  private:
    std::size_t bytes() const { return static_cast<std::size_t>(count_) * sizeof(int); }

    int count_, gpu_;
    cudaStream_t stream_ = nullptr;
};

__device__ int thread_index() {
    return static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
}

// Results of a kernel that changes `numbers` in place.
template <class Kernel>
std::vector<int> results(Numbers& numbers, Kernel launch) {
    numbers.upload();
    launch();
    numbers.download();
    numbers.wait();
    return numbers.values();
}

__global__ void reverse_in_block(int* data, bool faulty) {
    __shared__ int values[kThreads];
    values[threadIdx.x] = data[thread_index()];
    if (!faulty) __syncthreads();
    data[thread_index()] = values[kThreads - 1 - threadIdx.x];
}
std::vector<int> missing_barrier(bool faulty) {
    Numbers numbers(kCount);
    return results(numbers, [&] {
        reverse_in_block<<<kBlocks, kThreads, 0, numbers.stream()>>>(numbers.device, faulty);
    });
}

__global__ void triple(int* data, int count) {
    if (thread_index() < count) data[thread_index()] = 3 * thread_index();
}
std::vector<int> off_by_one(bool faulty) {
    Numbers numbers(kCount - 8);
    const int count = kCount - 8 + faulty;
    return results(numbers,
                   [&] { triple<<<kBlocks, kThreads, 0, numbers.stream()>>>(numbers.device, count); });
}

template <int kSize>
__global__ void reverse_by_array(int* data) {
    __shared__ int values[kSize];
    values[threadIdx.x] = data[thread_index()];
    __syncthreads();
    data[thread_index()] = values[kThreads - 1 - threadIdx.x];
}
std::vector<int> small_shared_array(bool faulty) {
    constexpr int kSmall = kThreads - 1;
    Numbers numbers(kCount);
    return results(numbers, [&] {
        if (faulty) {
            reverse_by_array<kSmall><<<kBlocks, kThreads, 0, numbers.stream()>>>(numbers.device);
        } else {
            reverse_by_array<kThreads><<<kBlocks, kThreads, 0, numbers.stream()>>>(numbers.device);
        }
    });
}

std::vector<int> missing_wait(bool faulty) {
    Numbers numbers(kCount);
    numbers.upload();
    triple<<<kBlocks, kThreads, 0, numbers.stream()>>>(numbers.device, kCount);
    numbers.download();
    if (!faulty) numbers.wait();
    return numbers.values();
}

__global__ void count_values(const int* data, int* counts) {
    atomicAdd(counts + data[thread_index()] % 4, 1);
}
std::vector<int> uncleared_counts(bool faulty) {
    Numbers numbers(kCount), counts(4);
    numbers.upload();
    numbers.wait();
    if (!faulty) {
        counts.clear();
        counts.wait();
    }
    count_values<<<kBlocks, kThreads, 0, counts.stream()>>>(numbers.device, counts.device);
    counts.download();
    counts.wait();
    return counts.values();
}

__global__ void reverse_in_half(int* data, bool faulty) {
    __shared__ int values[kThreads];
    values[threadIdx.x] = data[thread_index()];
    if (!faulty || threadIdx.x < kThreads / 2) __syncthreads();
    data[thread_index()] = values[kThreads - 1 - threadIdx.x];
}
std::vector<int> divergent_barrier(bool faulty) {
    Numbers numbers(kCount);
    return results(numbers, [&] {
        reverse_in_half<<<kBlocks, kThreads, 0, numbers.stream()>>>(numbers.device, faulty);
    });
}

__global__ void add_table(int* data, const int* table) {
    data[thread_index()] += table[threadIdx.x];
}
std::vector<int> host_pointer(bool faulty) {
    Numbers numbers(kCount), table(kThreads);
    const std::vector<int> on_host = table.values();
    table.upload();
    table.wait();
    const int* read = faulty ? on_host.data() : table.device;
    return results(numbers,
                   [&] { add_table<<<kBlocks, kThreads, 0, numbers.stream()>>>(numbers.device, read); });
}

__global__ void sum_pairs(int* data, bool faulty) {
    if (faulty && threadIdx.x >= kThreads - 8) return;
    const int value = data[thread_index()];
    data[thread_index()] = value + __shfl_xor_sync(kAllLanes, value, 1);
}
std::vector<int> early_return_before_shuffle(bool faulty) {
    Numbers numbers(kCount);
    return results(numbers,
                   [&] { sum_pairs<<<kBlocks, kThreads, 0, numbers.stream()>>>(numbers.device, faulty); });
}

__global__ void sum_all(const int* data, int* sum, bool faulty) {
    if (faulty) {
        *sum += data[thread_index()];
    } else {
        atomicAdd(sum, data[thread_index()]);
    }
}
std::vector<int> plain_add_for_atomic(bool faulty) {
    Numbers numbers(kCount), sum(1);
    numbers.upload();
    numbers.wait();
    sum.clear();
    sum_all<<<kBlocks, kThreads, 0, sum.stream()>>>(numbers.device, sum.device, faulty);
    sum.download();
    sum.wait();
    return sum.values();
}

__global__ void double_values(int* data) {
    data[thread_index()] *= 2;
}
std::vector<int> missing_upload(bool faulty) {
    Numbers numbers(kCount);
    if (!faulty) numbers.upload();
    double_values<<<kBlocks, kThreads, 0, numbers.stream()>>>(numbers.device);
    numbers.download();
    numbers.wait();
    return numbers.values();
}

__global__ void add_neighbour(const int* from, int* to) {
    to[thread_index()] = from[thread_index()] + from[(thread_index() + 1) % kCount];
}
std::vector<int> neighbour_read_while_written(bool faulty) {
    Numbers numbers(kCount), sums(kCount);
    numbers.upload();
    numbers.wait();
    Numbers& to = faulty ? numbers : sums;
    add_neighbour<<<kBlocks, kThreads, 0, to.stream()>>>(numbers.device, to.device);
    to.download();
    to.wait();
    return to.values();
}

__global__ void sum_blocks(const int* data, int* sums, bool faulty) {
    __shared__ int sum;
    if (threadIdx.x == 0 && !faulty) sum = 0;
    __syncthreads();
    atomicAdd(&sum, data[thread_index()]);
    __syncthreads();
    if (threadIdx.x == 0) sums[blockIdx.x] = sum;
}
std::vector<int> uninitialised_read(bool faulty) {
    Numbers numbers(kCount), sums(kBlocks);
    numbers.upload();
    numbers.wait();
    sum_blocks<<<kBlocks, kThreads, 0, sums.stream()>>>(numbers.device, sums.device, faulty);
    sums.download();
    sums.wait();
    return sums.values();
}

std::vector<int> another_gpus_stream(bool faulty) {
    Numbers numbers(kCount);
    if (faulty) cudaSetDevice(1);
    return results(numbers,
                   [&] { triple<<<kBlocks, kThreads, 0, numbers.stream()>>>(numbers.device, kCount); });
}

std::vector<int> another_gpus_memory(bool faulty) {
    Numbers table(kThreads, faulty ? 1 : 0);
    table.upload();
    table.wait();
    Numbers numbers(kCount);
    return results(numbers, [&] {
        add_table<<<kBlocks, kThreads, 0, numbers.stream()>>>(numbers.device, table.device);
    });
}

constexpr Fault kFaults[] = {
    {"missing_barrier", missing_barrier},
    {"off_by_one", off_by_one},
    {"small_shared_array", small_shared_array},
    {"missing_wait", missing_wait},
    {"uncleared_counts", uncleared_counts},
    {"divergent_barrier", divergent_barrier},
    {"host_pointer", host_pointer},
    {"early_return_before_shuffle", early_return_before_shuffle},
    {"plain_add_for_atomic", plain_add_for_atomic},
    {"missing_upload", missing_upload},
    {"neighbour_read_while_written", neighbour_read_while_written},
    {"uninitialised_read", uninitialised_read},
    {"another_gpus_stream", another_gpus_stream},
    {"another_gpus_memory", another_gpus_memory},
};

}  // namespace

std::span<const Fault> all() {
    return kFaults;
}

}  // namespace planted_faults
