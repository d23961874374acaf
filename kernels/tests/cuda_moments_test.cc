// The CUDA form of the moments against the CPU form: the mapping has the same bits, the moments differ by
// roundings. Skips without a GPU; with KINEVOX_REQUIRE_GPU in the environment it fails instead.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

#include "kernels/moments.h"
#include "kernels/tests/moment_shapes.h"
#include "kernels/tests/tested_gpu.h"

namespace kinevox::kernels {
namespace {

using testing::draw_figure;
using testing::ShapeMask;

TEST(CudaMoments, EqualCpuForm) {
    for (const MomentOptions& options : {MomentOptions{}, MomentOptions{.order = 20, .grid = 128}}) {
        std::unique_ptr<MomentCalculator> gpu;
        try {
            gpu = make_moment_calculator(testing::tested_gpu(), options);
        } catch (const std::runtime_error& error) {
            EXPECT_THAT(error.what(), ::testing::HasSubstr("use device cpu"));
            if (std::getenv("KINEVOX_REQUIRE_GPU")) FAIL() << "a GPU was asked for, but: " << error.what();
            GTEST_SKIP() << "not compared with the CPU: " << error.what();
        }
        std::vector<ShapeMask> masks;
        for (int n = 0; n < 5; ++n)
            masks.push_back(draw_figure(320, 240, 130 + 9 * n, 120, 40 + 15 * n, 0.3 * n));
        std::vector<MomentView> views;
        for (const ShapeMask& mask : masks) views.push_back(mask.view());
        views.push_back({});
        views.push_back(masks[1].view({140.f, 118.f, 90.f}));
        views.push_back(masks[2].view());
        views.back().bounds = {100, 60, 171, 133};  // cut by its box
        std::vector<SilhouetteMoments> on_cpu, on_gpu, again;
        make_moment_calculator(Device::kCpu, options)->compute(views, on_cpu);
        gpu->compute(views, on_gpu);
        gpu->compute(views, again);
        for (std::size_t n = 0; n < views.size(); ++n) {
            EXPECT_EQ(on_gpu[n].values, again[n].values);
            EXPECT_EQ(on_gpu[n].mass_px, on_cpu[n].mass_px);
            EXPECT_EQ(on_gpu[n].mapping.radius_px, on_cpu[n].mapping.radius_px);
            EXPECT_EQ(on_gpu[n].mapping.centre_x_px, on_cpu[n].mapping.centre_x_px);
            EXPECT_THAT(on_gpu[n].values,
                        ::testing::Pointwise(::testing::FloatNear(2e-6f), on_cpu[n].values));
        }
    }
}

}  // namespace
}  // namespace kinevox::kernels
