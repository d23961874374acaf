#include "kernels/device.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "kernels/device_facts.h"

namespace kinevox::kernels {
namespace {

TEST(Device, IsNamedAsItIsRead) {
    EXPECT_EQ(name_of(Device::kCpu), "cpu");
    EXPECT_EQ(name_of(Device::kCuda), "cuda:0");
    for (const Device device : {Device::kCpu, Device::kCuda, Device::cuda(1), Device::cuda(999)})
        EXPECT_EQ(device_of_name(name_of(device)), device);
    EXPECT_EQ(device_of_name("cuda"), Device::cuda(0));
    EXPECT_FALSE(Device().is_cuda());
    EXPECT_TRUE(Device::cuda(1).is_cuda());
    EXPECT_EQ(Device::cuda(1).index(), 1);
}

TEST(Device, RefusesOtherNames) {
    for (const char* name : {"", "gpu", "CPU", "cpu:0", "cuda:", "cuda:-1", "cuda:+1", "cuda:00", "cuda:1 ",
                             "cuda:1000", "cuda:99999999999999999999"})
        EXPECT_EQ(device_of_name(name), std::nullopt) << name;
}

GpuFacts gpu(int index, int multiprocessors, std::uint64_t free_bytes, const char* problem = "") {
    GpuFacts facts;
    facts.device = Device::cuda(index);
    facts.multiprocessors = multiprocessors;
    facts.free_bytes = free_bytes;
    facts.problem = problem;
    return facts;
}

TEST(RecommendedDevice, IsLargestUsableGpuThenTheOneWithMostFreeMemory) {
    CudaFacts facts;
    EXPECT_EQ(recommended_device(facts), Device::kCpu);
    facts.gpus = {gpu(0, 132, 900, "broken")};
    EXPECT_EQ(recommended_device(facts), Device::kCpu);
    facts.gpus.push_back(gpu(1, 40, 500));
    EXPECT_EQ(recommended_device(facts), Device::cuda(1));
    facts.gpus.push_back(gpu(2, 80, 100));
    EXPECT_EQ(recommended_device(facts), Device::cuda(2));
    facts.gpus.push_back(gpu(3, 80, 200));
    facts.gpus.push_back(gpu(4, 80, 200));
    EXPECT_EQ(recommended_device(facts), Device::cuda(3));
}

TEST(CpuFacts, CountsCoresAndListsInstructionSets) {
    const CpuFacts facts = cpu_facts();
    EXPECT_GE(facts.logical_cores, 1);
#ifdef __x86_64__
    EXPECT_FALSE(facts.model.empty());
    const bool avx2 =
        __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
    EXPECT_EQ(std::ranges::count(facts.instruction_sets, "AVX2"), avx2);
#endif
}

TEST(CudaFacts, NameProblemAndRemedyWithoutGpu) {
    const CudaFacts facts = cuda_facts();
    EXPECT_EQ(facts.problem.empty(), !facts.gpus.empty());
    EXPECT_EQ(facts.remedy.empty(), facts.problem.empty());
    for (const GpuFacts& gpu : facts.gpus) EXPECT_EQ(gpu.remedy.empty(), gpu.usable());
}

}  // namespace
}  // namespace kinevox::kernels
