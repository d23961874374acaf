// Marks what runs on the CPU and in CUDA kernels alike: plain functions on plain data, no library, no
// exception.
#pragma once

#ifdef __CUDACC__
#define KINEVOX_HD __host__ __device__
#else
#define KINEVOX_HD
#endif

// For bodies that are compiled once more with wider vectors: they must be inlined into the function that
// asks.
#define KINEVOX_INLINE inline __attribute__((always_inline))
