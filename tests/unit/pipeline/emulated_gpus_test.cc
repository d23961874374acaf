// Pipelines on the second of two GPUs, which tests/cuda/emulator executes on the CPU.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "tests/cuda/emulator/devices.h"
#include "tests/unit/pipeline/small_pipeline.h"

namespace kinevox {
namespace {

using kernels::Device;
using ::testing::AllOf;
using ::testing::ElementsAre;
using testing::errors_in;
using testing::expect_same;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::kFrames;
using testing::run;
using ::testing::SizeIs;
using testing::small_options;
using testing::studio;
using testing::volume_of;

std::shared_ptr<Gpu> gpu(int index) {
    return std::make_shared<Gpu>(kernels::make_stage_factory(Device::cuda(index)));
}

PipelineOptions only_on(Device device) {
    PipelineOptions options = small_options(nullptr);
    options.device = device;
    return options;
}

TEST(EmulatedGpus, PipelinesOnTwoGpusComputeAtOnce) {
    std::vector<FrameResultPtr> results[2];
    std::thread first([&] { results[0] = run(gpu(0)); });
    std::thread second([&] { results[1] = run(only_on(Device::cuda(1))); });
    first.join();
    second.join();
    for (const auto& of_gpu : results) ASSERT_THAT(of_gpu, SizeIs(kFrames));
    EXPECT_GT(volume_of(results[1].back()), 20);
    EXPECT_THAT(errors_in(results[0]), IsEmpty());
    for (int frame = 0; frame < kFrames; ++frame) expect_same(results[0][frame], results[1][frame]);
}

TEST(EmulatedGpus, FailureOfSecondGpuMovesItsWorkToCpuAndNamesIt) {
    constexpr int kFailing = 8;
    const auto first = gpu(0), second = gpu(1);
    cuda_emulator::take_devices_with_context();
    const auto results = run(second, [&](int frame) {
        EXPECT_EQ(second->usable(), frame <= kFailing);
        if (frame == kFailing) cuda_emulator::break_device(1);
    });
    cuda_emulator::repair_devices();
    EXPECT_THAT(cuda_emulator::take_devices_with_context(), ElementsAre(1)) << "no other GPU is touched";
    ASSERT_THAT(results, SizeIs(kFrames));
    EXPECT_GT(volume_of(results.back()), 20);
    EXPECT_THAT(
        errors_in(results),
        ElementsAre(AllOf(HasSubstr("the GPU cuda:1 (CUDA emulator) failed: CUDA: an illegal memory access"),
                          HasSubstr("; the CPU computes since "))));
    EXPECT_TRUE(first->usable());
}

TEST(EmulatedGpus, AbsentGpuLeavesWorkToCpuAndIsNamed) {
    const auto expected = run(only_on(Device::kCpu)), results = run(gpu(2));
    ASSERT_THAT(results, SizeIs(kFrames));
    for (int frame = 0; frame < kFrames; ++frame) expect_same(results[frame], expected[frame]);
    EXPECT_THAT(
        errors_in(results),
        ElementsAre(HasSubstr("the GPU cuda:2 failed: there is no cuda:2; this machine has 2 GPUs, cuda:0 to "
                              "cuda:1 (`kinevox devices` lists them); the CPU computes since ")));
}

TEST(EmulatedGpus, AbsentGpuIsErrorWithoutFallback) {
    const auto pipeline = Pipeline::create(studio()->cameras(), 30, only_on(Device::cuda(2)));
    EXPECT_EQ(pipeline.status().code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(pipeline.status().message()),
                AllOf(HasSubstr("there is no cuda:2; this machine has 2 GPUs"), HasSubstr("use device cpu")));
}

}  // namespace
}  // namespace kinevox
