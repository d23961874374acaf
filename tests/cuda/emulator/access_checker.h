// Checks every access of a kernel, if kernels are compiled with -fsanitize=thread and access_checker.cc
// answers instead of ThreadSanitizer's library: races between CUDA threads in global and shared memory, reads
// of uninitialised memory, accesses outside of allocations, to the host's memory or to another GPU's.
// Otherwise these functions do nothing.
#pragma once

#include <cstddef>
#include <cstdint>

namespace cuda_emulator::access {

#ifdef CUDA_EMULATOR_CHECKS_ACCESSES
void allocated(const void* memory, std::size_t bytes, bool device, int gpu);
void freed(const void* memory);
void written(const void* memory, std::size_t bytes);  // by a copy or cudaMemsetAsync
void gpu_runs(int gpu);                               // whose memory kernels may access from now on
void kernel_begins(const char* name, const void* arguments, std::size_t bytes);
void block_begins(std::uint64_t block);
void shared_memory_begins(const void* memory, std::size_t bytes);  // of the running block
// `state`: the memory that threadIdx and the like read.
void thread_runs(int number, const void* stack, std::size_t stack_bytes, const void* state,
                 std::size_t state_bytes);
void host_runs();
void barrier_passed();  // by all threads of the block
#else
inline void allocated(const void*, std::size_t, bool, int) {}
inline void freed(const void*) {}
inline void written(const void*, std::size_t) {}
inline void gpu_runs(int) {}
inline void kernel_begins(const char*, const void*, std::size_t) {}
inline void block_begins(std::uint64_t) {}
inline void shared_memory_begins(const void*, std::size_t) {}
inline void thread_runs(int, const void*, std::size_t, const void*, std::size_t) {}
inline void host_runs() {}
inline void barrier_passed() {}
#endif

}  // namespace cuda_emulator::access
