// KINEVOX_HD marks the small functions that the CPU and the CUDA form of a stage share.
#pragma once

#ifdef __CUDACC__
#define KINEVOX_HD __host__ __device__ inline
#else
#define KINEVOX_HD inline
#endif
