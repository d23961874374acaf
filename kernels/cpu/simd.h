// Eight lanes at a time. A hot loop is written once, with the compiler's own vector types, and compiled
// twice: for every x86-64 and for AVX2; have_avx2() picks at run time. No -march flag, no second copy of any
// inline function that the linker could pick by mistake: the body is marked KINEVOX_INLINE and so are the
// functions it calls.
#pragma once

#include <cstdint>
#include <cstring>

// Clang rejects vector arguments between functions of different targets, inlined or not; it uses the plain
// forms.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define KINEVOX_HAVE_AVX2_FORM 1
#define KINEVOX_AVX2 __attribute__((target("avx2,fma,bmi,bmi2,popcnt")))
#define KINEVOX_AVX512 __attribute__((target("avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi,bmi2,popcnt")))
#define KINEVOX_AVX2_EXACT \
    __attribute__((target("avx2,bmi,bmi2,popcnt")))  // every product rounded, as without
#endif

#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wpsabi"  // vectors never cross a call that is not inlined
#endif

namespace kinevox::kernels {

inline constexpr int kLanes = 8;
typedef float Floats __attribute__((vector_size(32)));
typedef std::int32_t Ints __attribute__((vector_size(32)));

inline __attribute__((always_inline)) Floats splat(float value) {
    return Floats{} + value;
}
inline __attribute__((always_inline)) Floats to_floats(const Ints& v) {
    return __builtin_convertvector(v, Floats);
}
inline __attribute__((always_inline)) Ints to_ints(const Floats& v) {
    return __builtin_convertvector(v, Ints);
}  // truncates
inline __attribute__((always_inline)) Ints clamp_lanes(const Ints& v, int low, int high) {
    const Ints raised = v < low ? Ints{} + low : v;
    return raised > high ? Ints{} + high : raised;
}

inline bool have_avx2() {
#ifdef KINEVOX_HAVE_AVX2_FORM
    static const bool have =
        __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
    return have;
#else
    return false;
#endif
}

inline bool have_avx512() {
#ifdef KINEVOX_HAVE_AVX2_FORM
    static const bool have = have_avx2() && __builtin_cpu_supports("avx512f") &&
                             __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
                             __builtin_cpu_supports("avx512vl");
    return have;
#else
    return false;
#endif
}

}  // namespace kinevox::kernels
