// What a pipeline does when its GPU fails: the frame set is finished on the CPU, and the clients hear of it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <set>
#include <string>
#include <tuple>

#include "tests/support/failing_gpu.h"
#include "tests/unit/pipeline/small_pipeline.h"

namespace kinevox {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using testing::errors_in;
using testing::expect_same;
using ::testing::HasSubstr;
using testing::kFrames;
using testing::run;
using ::testing::SizeIs;
using testing::small_options;
using testing::studio;
using testing::volume_of;

std::shared_ptr<Gpu> gpu_that(testing::GpuFails fails, std::string problem = {}, bool at_once = false) {
    return std::make_shared<Gpu>(std::make_unique<testing::FailingGpu>(std::move(fails), std::move(problem),
                                                                       at_once, kernels::Device::cuda(1)));
}

// A stage, and whether the GPU carves and colours at once.
class FailsIn : public ::testing::TestWithParam<std::tuple<std::string, bool>> {};

// After a failure in any stage of any frame set, that frame set has the same result, and the others continue.
TEST_P(FailsIn, FinishesFrameSetOnCpu) {
    constexpr int kFailing = 8;
    const auto& [failing_stage, at_once] = GetParam();
    const auto undisturbed = run(nullptr);
    ASSERT_THAT(undisturbed, SizeIs(kFrames));
    ASSERT_GT(volume_of(undisturbed[kFailing]), 20) << "the subject must be visible by then";
    std::atomic<bool> failing = false;
    std::atomic<int> asked_after = 0;
    bool failed = false;
    const auto gpu = gpu_that(
        [&](const std::string& stage) {
            if (failed) ++asked_after;
            return failing && stage == std::get<0>(GetParam());
        },
        {}, at_once);
    const auto results = run(gpu, [&](int frame) {
        EXPECT_EQ(gpu->usable(), frame <= kFailing);
        failed = frame > kFailing;
        failing = frame >= kFailing;
    });
    ASSERT_THAT(results, SizeIs(kFrames));
    for (int frame = 0; frame < kFailing; ++frame) expect_same(results[frame], undisturbed[frame]);
    // What a failing segmentation is replaced by knows the empty scene only.
    if (failing_stage != "segmentation") expect_same(results[kFailing], undisturbed[kFailing]);
    for (int frame = kFailing; frame < kFrames; ++frame)
        EXPECT_NEAR(volume_of(results[frame]), volume_of(undisturbed[frame]),
                    0.1 * volume_of(undisturbed[frame]));
    EXPECT_EQ(asked_after, 0) << "the GPU is left alone once it has failed";
    EXPECT_THAT(errors_in(results),
                ElementsAre(AllOf(HasSubstr("the GPU cuda:1 (a GPU made to fail) failed: CUDA: "),
                                  HasSubstr("; the CPU computes since "), HasSubstr("restart"))));
    EXPECT_EQ(gpu->state().failures, 1u);
    EXPECT_EQ(gpu->state().memory.total_bytes, 0u);
}

INSTANTIATE_TEST_SUITE_P(Stages, FailsIn,
                         ::testing::Combine(::testing::Values("segmentation", "hull", "colouring"),
                                            ::testing::Bool()));

TEST(GpuFallback, UsesAndReportsWorkingGpu) {
    std::set<std::string> used;
    std::mutex mutex;
    const auto gpu = gpu_that([&](const std::string& stage) {
        const std::scoped_lock lock(mutex);
        used.insert(stage);
        return false;
    });
    const auto results = run(gpu);
    EXPECT_THAT(used,
                ::testing::UnorderedElementsAre("making", "learning", "segmentation", "hull", "colouring"));
    EXPECT_THAT(errors_in(results), SizeIs(0));
    EXPECT_TRUE(gpu->state().usable);
    EXPECT_EQ(gpu->state().device, "cuda:1");
    EXPECT_EQ(gpu->state().name, "a GPU made to fail");
    EXPECT_EQ(gpu->state().message, "");
    EXPECT_EQ(gpu->state().memory.used_bytes, std::uint64_t{3} << 30);
}

// From the first frame set on, so that nothing of the GPU's is missed: the CPU's own results, bit for bit.
TEST(GpuFallback, ChangesNothingButTheDevice) {
    const auto expected = run(nullptr);
    const auto says = [](const char* stage) {
        return [stage](const std::string& asked) { return asked == stage; };
    };
    for (const auto& gpu :
         {gpu_that(says("making")), gpu_that(says("learning")), gpu_that(says("segmentation")),
          gpu_that(says("none"), "this machine has no CUDA device")}) {
        const auto results = run(gpu);
        ASSERT_THAT(results, SizeIs(kFrames));
        for (int frame = 0; frame < kFrames; ++frame) expect_same(results[frame], expected[frame]);
        EXPECT_THAT(errors_in(results), SizeIs(1));
        EXPECT_FALSE(gpu->usable());
    }
}

TEST(GpuFallback, KeepsFailedGpuUnusedInOtherPipelines) {
    std::atomic<int> asked = 0;
    const auto gpu = gpu_that([&](const std::string&) { return ++asked, false; });
    gpu->report_failure("CUDA: out of memory");
    gpu->report_failure("CUDA: out of memory, once more");
    const auto results = run(gpu);
    EXPECT_THAT(results, SizeIs(kFrames));
    EXPECT_EQ(asked, 0);
    EXPECT_EQ(gpu->state().failures, 2u);
    EXPECT_THAT(errors_in(results), ElementsAre(HasSubstr("failed: CUDA: out of memory; ")));
    EXPECT_EQ(gpu->take_message(), "") << "reported once";
    EXPECT_THAT(gpu->state().message, HasSubstr("out of memory")) << "and to be had afterwards";
}

TEST(GpuFallback, FailsWithoutFallback) {
    PipelineOptions options = small_options(nullptr);
    options.device = kernels::Device::kCuda;
    if (kernels::make_stage_factory(kernels::Device::kCuda)->problem().empty())
        GTEST_SKIP() << "there is a GPU";
    const auto pipeline = Pipeline::create(studio()->cameras(), 30, options);
    EXPECT_EQ(pipeline.status().code(), absl::StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace kinevox
