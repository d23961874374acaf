#include <fstream>
#include <thread>

#include "kernels/cpu/simd.h"
#include "kernels/device_facts.h"

#ifdef KINEVOX_HAVE_HIGHWAY
#include <hwy/highway.h>
#include <hwy/targets.h>
#endif

namespace kinevox::kernels {
namespace {

std::string cpu_model() {
    std::ifstream file("/proc/cpuinfo");
    for (std::string line; std::getline(file, line);)
        if (const auto colon = line.find(": "); line.starts_with("model name") && colon != std::string::npos)
            return line.substr(colon + 2);
    return {};
}

// Whether one of the forms that Highway chooses between is for this instruction set.
[[maybe_unused]] bool highway_uses([[maybe_unused]] std::int64_t target) {
#ifdef KINEVOX_HAVE_HIGHWAY
    return (hwy::SupportedTargets() & HWY_TARGETS & target) != 0;
#else
    return false;
#endif
}

}  // namespace

CpuFacts cpu_facts() {
    CpuFacts facts;
    facts.model = cpu_model();
    facts.logical_cores = static_cast<int>(std::thread::hardware_concurrency());
#if defined(KINEVOX_HAVE_HIGHWAY) && defined(__x86_64__)
    const bool avx2 = have_avx2() || highway_uses(HWY_AVX2);
    const bool avx512 = have_avx512() || highway_uses(HWY_AVX3);
#else
    const bool avx2 = have_avx2(), avx512 = have_avx512();
#endif
    if (avx2) facts.instruction_sets.emplace_back("AVX2");
    if (avx512) facts.instruction_sets.emplace_back("AVX-512");
    return facts;
}

}  // namespace kinevox::kernels
