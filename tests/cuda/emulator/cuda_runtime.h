// The part of CUDA's runtime and device language that kernels/cuda uses, executed on the CPU. Takes the place
// of CUDA's own header and is included before each translated .cu file (translate_launches.py).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <tuple>
#include <utility>

#define __global__
#define __device__
#define __host__
#define __forceinline__ inline
#define __launch_bounds__(...)

struct dim3 {
    unsigned x = 1, y = 1, z = 1;
    constexpr dim3(unsigned x_ = 1, unsigned y_ = 1, unsigned z_ = 1) : x(x_), y(y_), z(z_) {}
};
struct uint3 {
    unsigned x, y, z;
};
struct int2 {
    int x, y;
};
struct alignas(16) int4 {
    int x, y, z, w;
};
struct uint2 {
    unsigned x, y;
};
struct alignas(16) uint4 {
    unsigned x, y, z, w;
};
struct short2 {
    short x, y;
};
struct float2 {
    float x, y;
};
struct float3 {
    float x, y, z;
};
struct alignas(16) float4 {
    float x, y, z, w;
};
struct uchar4 {
    unsigned char x, y, z, w;
};

// ---- runtime ----
enum cudaError_t {
    cudaSuccess = 0,
    cudaErrorInvalidValue = 1,
    cudaErrorMemoryAllocation = 2,
    cudaErrorInvalidConfiguration = 9,
    cudaErrorInsufficientDriver = 35,
    cudaErrorNoDevice = 100,
    cudaErrorInvalidDevice = 101,
    cudaErrorNoKernelImageForDevice = 209,
    cudaErrorUnsupportedPtxVersion = 222,
    cudaErrorIllegalAddress = 700,
    cudaErrorStreamCaptureUnsupported = 900
};
enum cudaMemcpyKind { cudaMemcpyHostToDevice = 1, cudaMemcpyDeviceToHost = 2, cudaMemcpyDeviceToDevice = 3 };
enum cudaStreamCaptureMode { cudaStreamCaptureModeGlobal, cudaStreamCaptureModeThreadLocal };
inline constexpr unsigned cudaStreamNonBlocking = 1;
#define CUDART_VERSION 12040
struct cudaDeviceProp {
    char name[256];
    int major, minor, multiProcessorCount;
    std::size_t totalGlobalMem;
};
namespace cuda_emulator {
struct Stream;
struct Graph;
}  // namespace cuda_emulator
using cudaStream_t = cuda_emulator::Stream*;
using cudaGraph_t = cuda_emulator::Graph*;
using cudaGraphExec_t = cuda_emulator::Graph*;

cudaError_t cudaStreamCreateWithFlags(cudaStream_t* stream, unsigned flags);
cudaError_t cudaStreamDestroy(cudaStream_t stream);
cudaError_t cudaStreamSynchronize(cudaStream_t stream);
cudaError_t cudaMalloc(void** memory, std::size_t bytes);
cudaError_t cudaMallocHost(void** memory, std::size_t bytes);
cudaError_t cudaFree(void* memory);
cudaError_t cudaFreeHost(void* memory);
cudaError_t cudaMemcpyAsync(void* to, const void* from, std::size_t bytes, cudaMemcpyKind kind,
                            cudaStream_t stream);
cudaError_t cudaMemcpy2DAsync(void* to, std::size_t to_pitch, const void* from, std::size_t from_pitch,
                              std::size_t bytes, std::size_t rows, cudaMemcpyKind kind, cudaStream_t stream);
cudaError_t cudaMemsetAsync(void* to, int value, std::size_t bytes, cudaStream_t stream);
cudaError_t cudaStreamBeginCapture(cudaStream_t stream, cudaStreamCaptureMode mode);
cudaError_t cudaStreamEndCapture(cudaStream_t stream, cudaGraph_t* graph);
cudaError_t cudaGraphInstantiate(cudaGraphExec_t* executable, cudaGraph_t graph,
                                 unsigned long long flags = 0);
cudaError_t cudaGraphLaunch(cudaGraphExec_t executable, cudaStream_t stream);
cudaError_t cudaGraphDestroy(cudaGraph_t graph);
cudaError_t cudaGraphExecDestroy(cudaGraphExec_t executable);
cudaError_t cudaGetLastError();
const char* cudaGetErrorString(cudaError_t error);
cudaError_t cudaGetDeviceCount(int* count);
cudaError_t cudaGetDevice(int* device);
cudaError_t cudaSetDevice(int device);
cudaError_t cudaDeviceGetPCIBusId(char* id, int bytes, int device);
cudaError_t cudaDriverGetVersion(int* version);
cudaError_t cudaRuntimeGetVersion(int* version);
cudaError_t cudaGetDeviceProperties(cudaDeviceProp* properties, int device);
cudaError_t cudaMemGetInfo(std::size_t* free_bytes, std::size_t* total_bytes);

// ---- launches ----
namespace cuda_emulator {

struct Block;
struct Thread {
    uint3 index{};
    Block* block = nullptr;
    unsigned exchanges = 0;  // of the warp, so far
};
struct Block {
    uint3 index{};
    dim3 size, grid;
};
extern __thread Thread* current;  // the CUDA thread that runs now

struct Launch {
    dim3 grid, block;
    std::size_t shared_bytes = 0;
    cudaStream_t stream = nullptr;
};
// A kernel with its arguments, which are copied at the launch, as CUDA does.
struct Call {
    virtual ~Call() = default;
    virtual void run() const = 0;
};
void enqueue(const Launch& launch, const char* name, std::shared_ptr<const Call> call, std::size_t bytes);

// kernel<<<...>>>(...), translated.
template <class... P>
struct Launcher {
    Launch launch;
    const char* name;
    void (*kernel)(P...);
    struct Arguments final : Call {
        void (*kernel)(P...);
        std::tuple<P...> values;
        void run() const override { std::apply(kernel, values); }
    };
    void operator()(P... arguments) const {
        auto call = std::make_shared<Arguments>();
        call->kernel = kernel;
        call->values = std::tuple<P...>(arguments...);
        enqueue(launch, name, call, sizeof(Arguments));
    }
};
template <class... P>
Launcher<P...> launcher(const Launch& launch, const char* name, void (*kernel)(P...)) {
    return {launch, name, kernel};
}

// ---- what a block's threads share ----
// The running block's variable; `key` is unique to its declaration.
void* shared_memory(const void* key, const char* name, std::size_t bytes, std::size_t alignment);
void* dynamic_shared_memory();

// __shared__ T name, translated; the type of `Key` is a lambda's and so unique.
template <class T, class Key>
T& shared_variable(Key, const char* name) {
    static const char key = 0;
    return *static_cast<T*>(shared_memory(&key, name, sizeof(T), alignof(T)));
}

enum class Vote { kNone, kCount, kOr, kAnd };
int barrier(Vote vote, bool value, const char* site);
// The values of the warp's threads, by lane.
struct Lanes {
    std::uint64_t value[32];
};
// Waits for the warp's threads of `mask`. Written on the caller's stack, which the access checker ignores.
void exchange(unsigned mask, std::uint64_t value, const char* site, Lanes& out);
int lane();
[[noreturn]] void report_absent_lane(const char* site);

template <class T>
std::uint64_t bits_of(T value) {
    static_assert(sizeof(T) <= 8);
    std::uint64_t bits = 0;
    std::memcpy(&bits, &value, sizeof(T));
    return bits;
}
template <class T>
T shuffle(unsigned mask, T value, int from, const char* site) {
    Lanes lanes;
    exchange(mask, bits_of(value), site, lanes);
    if (from < 0 || from > 31) return value;
    if (!(mask >> from & 1)) report_absent_lane(site);
    T out;
    std::memcpy(&out, lanes.value + from, sizeof(T));
    return out;
}
inline unsigned ballot(unsigned mask, bool value, const char* site) {
    Lanes lanes;
    exchange(mask, value, site, lanes);
    unsigned out = 0;
    for (int n = 0; n < 32; ++n) out |= mask >> n & static_cast<unsigned>(lanes.value[n]) ? 1u << n : 0u;
    return out;
}
template <class T, class Combine>
T reduce(unsigned mask, T value, Combine combine, const char* site) {
    Lanes lanes;
    exchange(mask, bits_of(value), site, lanes);
    bool first = true;
    T out = value;
    for (int n = 0; n < 32; ++n) {
        if (!(mask >> n & 1)) continue;
        T other;
        std::memcpy(&other, lanes.value + n, sizeof(T));
        out = first ? other : combine(out, other);
        first = false;
    }
    return out;
}
template <class T, class Better>
T replace_if(T* to, T value, Better better) {
    T old = __atomic_load_n(to, __ATOMIC_RELAXED);
    while (better(value, old) &&
           !__atomic_compare_exchange_n(to, &old, value, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
    }
    return old;
}

}  // namespace cuda_emulator

#define threadIdx (::cuda_emulator::current->index)
#define blockIdx (::cuda_emulator::current->block->index)
#define blockDim (::cuda_emulator::current->block->size)
#define gridDim (::cuda_emulator::current->block->grid)

// The site of a barrier or vote shows whether all threads are at the same one (compute-sanitizer's
// synccheck).
#define CUDA_EMULATOR_TEXT_OF(x) #x
#define CUDA_EMULATOR_TEXT(x) CUDA_EMULATOR_TEXT_OF(x)
#define CUDA_EMULATOR_SITE __FILE__ ":" CUDA_EMULATOR_TEXT(__LINE__)
#define CUDA_EMULATOR_BARRIER(vote, value) \
    (::cuda_emulator::barrier(::cuda_emulator::Vote::vote, (value), CUDA_EMULATOR_SITE))
#define __syncthreads() (static_cast<void>(CUDA_EMULATOR_BARRIER(kNone, false)))
#define __syncthreads_count(value) CUDA_EMULATOR_BARRIER(kCount, (value))
#define __syncthreads_or(value) CUDA_EMULATOR_BARRIER(kOr, (value))
#define __syncthreads_and(value) CUDA_EMULATOR_BARRIER(kAnd, (value))
#define __syncwarp(...) (static_cast<void>(::cuda_emulator::ballot(0xffffffffu, false, CUDA_EMULATOR_SITE)))
#define __ballot_sync(mask, value) (::cuda_emulator::ballot((mask), (value), CUDA_EMULATOR_SITE))
#define __any_sync(mask, value) (__ballot_sync(mask, value) != 0)
#define __all_sync(mask, value) (__ballot_sync(mask, value) == (mask))
#define __shfl_sync(mask, value, from) (::cuda_emulator::shuffle((mask), (value), (from), CUDA_EMULATOR_SITE))
#define __shfl_up_sync(mask, value, delta) \
    __shfl_sync(mask, value, ::cuda_emulator::lane() - static_cast<int>(delta))
#define __shfl_down_sync(mask, value, delta) \
    __shfl_sync(mask, value, ::cuda_emulator::lane() + static_cast<int>(delta))
#define __shfl_xor_sync(mask, value, with) __shfl_sync(mask, value, ::cuda_emulator::lane() ^ (with))
#define CUDA_EMULATOR_REDUCE(mask, value, expression) \
    (::cuda_emulator::reduce((mask), (value), [](auto a, auto b) { return expression; }, CUDA_EMULATOR_SITE))
#define __reduce_add_sync(mask, value) CUDA_EMULATOR_REDUCE(mask, value, a + b)
#define __reduce_min_sync(mask, value) CUDA_EMULATOR_REDUCE(mask, value, b < a ? b : a)
#define __reduce_max_sync(mask, value) CUDA_EMULATOR_REDUCE(mask, value, a < b ? b : a)
#define __reduce_or_sync(mask, value) CUDA_EMULATOR_REDUCE(mask, value, a | b)

// ---- functions ----
template <class T>
T atomicAdd(T* to, std::type_identity_t<T> value) {
    return __atomic_fetch_add(to, value, __ATOMIC_RELAXED);
}
template <class T>
T atomicSub(T* to, std::type_identity_t<T> value) {
    return __atomic_fetch_sub(to, value, __ATOMIC_RELAXED);
}
template <class T>
T atomicOr(T* to, std::type_identity_t<T> value) {
    return __atomic_fetch_or(to, value, __ATOMIC_RELAXED);
}
template <class T>
T atomicAnd(T* to, std::type_identity_t<T> value) {
    return __atomic_fetch_and(to, value, __ATOMIC_RELAXED);
}
template <class T>
T atomicExch(T* to, std::type_identity_t<T> value) {
    return __atomic_exchange_n(to, value, __ATOMIC_RELAXED);
}
template <class T>
T atomicCAS(T* to, std::type_identity_t<T> expected, std::type_identity_t<T> value) {
    __atomic_compare_exchange_n(to, &expected, value, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED);
    return expected;
}
template <class T>
T atomicMin(T* to, std::type_identity_t<T> value) {
    return cuda_emulator::replace_if(to, value, [](T a, T b) { return a < b; });
}
template <class T>
T atomicMax(T* to, std::type_identity_t<T> value) {
    return cuda_emulator::replace_if(to, value, [](T a, T b) { return a > b; });
}

inline void __threadfence() {}
inline void __threadfence_block() {}
template <class T>
T __ldg(const T* from) {
    return *from;
}
inline int __popc(unsigned v) {
    return __builtin_popcount(v);
}
inline int __popcll(unsigned long long v) {
    return __builtin_popcountll(v);
}
inline int __ffs(int v) {
    return __builtin_ffs(v);
}
inline int __ffsll(long long v) {
    return __builtin_ffsll(v);
}
inline int __clz(int v) {
    return v == 0 ? 32 : __builtin_clz(static_cast<unsigned>(v));
}
inline int __clzll(long long v) {
    return v == 0 ? 64 : __builtin_clzll(static_cast<unsigned long long>(v));
}
inline unsigned __brev(unsigned v) {
    unsigned out = 0;
    for (int n = 0; n < 32; ++n) out |= (v >> n & 1u) << (31 - n);
    return out;
}
inline int __float_as_int(float v) {
    int out;
    std::memcpy(&out, &v, sizeof out);
    return out;
}
inline float __int_as_float(int v) {
    float out;
    std::memcpy(&out, &v, sizeof out);
    return out;
}
inline int min(int a, int b) {
    return b < a ? b : a;
}
inline int max(int a, int b) {
    return a < b ? b : a;
}
