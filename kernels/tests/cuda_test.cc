// The CUDA form of each stage against the CPU form. Equality is that of roundings: the CPU's vector forms
// contract products and sums where the device does not, so a voxel whose pixel border lies within about 1e-4
// px may fall on the other side. Everything else is whole-number work, the same by construction.
//
// Where no GPU is found the comparisons skip and say so; with KINEVOX_REQUIRE_GPU in the environment they
// fail.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <random>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "kernels/colouring.h"
#include "kernels/hull.h"
#include "kernels/tests/tested_gpu.h"
#include "kernels/tests/volume_scene.h"

namespace kinevox::kernels {
namespace {

using testing::bits_of;
using testing::box_distance;
using testing::make_lattice;
using testing::ring_of_cameras;
using testing::Scene;
using testing::sphere_distance;

// Why CUDA cannot be used here; empty where it can.
std::string why_no_cuda() {
    try {
        make_hull_carver(testing::tested_gpu());
    } catch (const std::runtime_error& error) {
        return error.what();
    }
    return {};
}

class Cuda : public ::testing::Test {
  protected:
    void SetUp() override {
        const std::string why = why_no_cuda();
        if (why.empty()) return;
        if (std::getenv("KINEVOX_REQUIRE_GPU")) FAIL() << "a GPU was asked for, but: " << why;
        GTEST_SKIP() << "not compared with the CPU: " << why;
    }
};

TEST(CudaAbsent, ErrorNamesCauseAndRemedy) {
    const std::string why = why_no_cuda();
    if (why.empty()) GTEST_SKIP() << "there is a GPU";
    EXPECT_THAT(why, ::testing::HasSubstr("use device cpu"));
    EXPECT_THROW(make_voxel_colourer(testing::tested_gpu()), std::runtime_error);
}

TEST(CudaAbsent, InvalidOptionsAreReportedFirst) {
    HullOptions options;
    options.min_views = 0;
    EXPECT_THROW(make_hull_carver(testing::tested_gpu(), options), std::invalid_argument);
}

void expect_sorted_and_filled(const VoxelVolume& volume) {
    for (std::size_t n = 0; n < volume.bricks.size(); ++n) {
        const Brick& b = volume.bricks[n];
        std::uint64_t any = 0;
        for (std::uint64_t slice : b.occupancy) any |= slice;
        EXPECT_NE(any, 0u);
        if (n == 0) continue;
        const Brick& a = volume.bricks[n - 1];
        EXPECT_LT(std::tie(a.z, a.y, a.x), std::tie(b.z, b.y, b.x));
    }
}

// Occupied voxels of the first, and how many differ.
std::pair<std::size_t, std::size_t> compare(const VoxelVolume& a, const VoxelVolume& b) {
    const auto left = bits_of(a), right = bits_of(b);
    EXPECT_EQ(left.size(), right.size());
    std::size_t filled = 0, different = 0;
    for (std::size_t n = 0; n < left.size() && n < right.size(); ++n) {
        filled += left[n];
        different += left[n] != right[n];
    }
    return {filled, different};
}

Colour checkerboard(const float* p) {
    const int n =
        static_cast<int>(std::floor(p[0] / 0.07f) + std::floor(p[1] / 0.07f) + std::floor(p[2] / 0.07f));
    return n % 2 ? Colour{200, 80, 30} : Colour{40, 90, 180};
}

struct HullCase {
    const char* name;
    int cameras;
    float k1, p1, voxel_m, budget_permille;
    int min_views;
    std::size_t min_filled = 500;  // voxels
};

class CudaHull : public Cuda, public ::testing::WithParamInterface<HullCase> {};

TEST_P(CudaHull, EqualsCpuForm) {
    const HullCase& param = GetParam();
    Scene scene = ring_of_cameras(param.cameras, param.k1, -0.4f * param.k1, param.p1);
    scene.cameras[0].cx -= 150;  // the subject is partly outside of this image
    scene.draw([](const float* p) {
        return std::min(box_distance(p, 0.1f, 0.2f, 0.35f), sphere_distance(p, 0.15f, 0.1f, 1.1f, 0.2f));
    });
    std::mt19937 random(3);
    for (std::uint8_t& pixel : scene.masks[1])
        if (random() % 50 == 0) pixel ^= 255;  // holes and specks
    const int n = static_cast<int>(1.2f / param.voxel_m) / 8 * 8;
    const Lattice lattice = make_lattice(param.voxel_m, n, n - 8, n + 8);
    HullOptions options;
    options.min_views = param.min_views;
    options.miss_budget_permille = param.budget_permille;
    VoxelVolume cpu, gpu, again;
    make_hull_carver(Device::kCpu, options)->carve(scene.hull_views(), lattice, cpu);
    auto carver = make_hull_carver(testing::tested_gpu(), options);
    carver->carve(scene.hull_views(), lattice, gpu);
    carver->carve(scene.hull_views(), lattice, again);
    const auto [filled, different] = compare(cpu, gpu);
    EXPECT_GT(filled, param.min_filled);
    EXPECT_LE(different, 2 + filled / 2000);
    EXPECT_EQ(gpu.lattice, lattice);
    EXPECT_TRUE(gpu.colours.empty());
    expect_sorted_and_filled(gpu);
    EXPECT_EQ(compare(gpu, again).second, 0u);
}

INSTANTIATE_TEST_SUITE_P(Shapes, CudaHull,
                         ::testing::Values(HullCase{"four", 4, 0, 0, 0.02f, 0, 2},
                                           HullCase{"budget", 4, 0, 0, 0.015f, 5, 2},
                                           HullCase{"wide_budget", 3, 0, 0, 0.03f, 50, 1},
                                           HullCase{"distorted", 5, -0.2f, 0.0005f, 0.01f, 3, 3},
                                           HullCase{"coarse", 8, 0.1f, 0, 0.06f, 0, 4, 400}),
                         [](const auto& info) { return info.param.name; });

TEST_F(Cuda, HullHandlesAbsentAndEmptyViews) {
    Scene scene = ring_of_cameras(4, 0, 0, 0);
    scene.draw([](const float* p) { return sphere_distance(p, 0, 0, 1.f, 0.25f); });
    const Lattice lattice = make_lattice(0.02f, 48, 48, 48);
    auto carver = make_hull_carver(testing::tested_gpu());
    auto cpu_carver = make_hull_carver(Device::kCpu);
    VoxelVolume cpu, gpu;
    const auto expect_same = [&](std::size_t least) {
        cpu_carver->carve(scene.hull_views(), lattice, cpu);
        carver->carve(scene.hull_views(), lattice, gpu);
        const auto [filled, different] = compare(cpu, gpu);
        EXPECT_GE(filled, least);
        EXPECT_LE(different, 2 + filled / 2000);
    };
    expect_same(100);
    scene.masks[2].clear();  // no image
    expect_same(100);
    std::fill(scene.masks[1].begin(), scene.masks[1].end(), std::uint8_t{0});  // nothing in sight
    expect_same(0);
    EXPECT_TRUE(gpu.bricks.empty());
    for (auto& mask : scene.masks) mask.clear();
    expect_same(0);
    EXPECT_THROW(carver->carve(scene.hull_views(), make_lattice(0.02f, 7, 8, 8), gpu), std::invalid_argument);
}

class CudaColouring : public Cuda {
  protected:
    void SetUp() override {
        Cuda::SetUp();
        if (IsSkipped() || HasFatalFailure()) return;
        scene = ring_of_cameras(5, -0.1f, 0.02f, 0.0003f);
        scene.draw(
            [](const float* p) {
                return std::min(box_distance(p, 0.12f, 0.2f, 0.3f),
                                sphere_distance(p, 0.2f, 0.1f, 1.1f, 0.2f));
            },
            checkerboard);
        make_hull_carver(Device::kCpu)->carve(scene.hull_views(), make_lattice(0.012f, 80, 88, 96), hull);
    }

    // Runs both forms on `hull`; at most `part` of the voxels may differ.
    void expect_same(const ColouringOptions& options, const std::vector<ColouringView>& views, double part) {
        VoxelVolume cpu = hull, gpu = hull, again = hull;
        ColouringReport cpu_report, gpu_report, again_report;
        make_voxel_colourer(Device::kCpu, options)->colour(views, cpu, cpu_report);
        auto colourer = make_voxel_colourer(testing::tested_gpu(), options);
        colourer->colour(views, gpu, gpu_report);
        for (int n = 0; n < 3; ++n) {  // from the second time on as a graph
            again = hull;
            colourer->colour(views, again, again_report);
        }
        EXPECT_EQ(gpu_report.rounds, again_report.rounds);
        EXPECT_EQ(gpu.colours, again.colours);
        EXPECT_EQ(compare(gpu, again).second, 0u);
        EXPECT_THAT(again_report.silhouette_iou,
                    ::testing::Pointwise(::testing::NanSensitiveFloatEq(), gpu_report.silhouette_iou));

        const auto [filled, different] = compare(cpu, gpu);
        EXPECT_LE(static_cast<double>(different), part * static_cast<double>(filled));
        EXPECT_NEAR(static_cast<double>(gpu_report.carved), static_cast<double>(cpu_report.carved),
                    2 + part * static_cast<double>(filled));
        EXPECT_NEAR(gpu_report.rounds, cpu_report.rounds, part > 0 ? 1 : 0);
        ASSERT_EQ(gpu_report.silhouette_iou.size(), cpu_report.silhouette_iou.size());
        for (std::size_t n = 0; n < views.size(); ++n) {
            const float a = gpu_report.silhouette_iou[n], b = cpu_report.silhouette_iou[n];
            EXPECT_TRUE((std::isnan(a) && std::isnan(b)) || std::fabs(a - b) < 0.002f + part)
                << a << " and " << b;
        }
        expect_sorted_and_filled(gpu);
        if (different > 0) return;
        ASSERT_EQ(gpu.colours.size(), cpu.colours.size());
        std::size_t off = 0;
        for (std::size_t n = 0; n < cpu.colours.size(); ++n) {
            const Colour a = gpu.colours[n], b = cpu.colours[n];
            off += std::abs(a.r - b.r) > 1 || std::abs(a.g - b.g) > 1 || std::abs(a.b - b.b) > 1;
        }
        EXPECT_LE(off, cpu.colours.size() / 200);
    }

    Scene scene;
    VoxelVolume hull;
};

TEST_F(CudaColouring, ColoursEqualCpuForm) {
    ColouringOptions options;
    options.max_rounds = 0;
    expect_same(options, scene.colouring_views(), 0);
}

TEST_F(CudaColouring, SharpTrimmingEqualsCpuForm) {
    scene.draw([](const float* p) { return box_distance(p, 0.1f, 0.17f, 0.27f); }, checkerboard);
    ColouringOptions options;
    options.max_rounds = 1;
    options.max_colour_difference_std = 0;
    options.min_support = 0;
    expect_same(options, scene.colouring_views(), 0.001);
}

TEST_F(CudaColouring, ColourCarvingEqualsCpuForm) {
    ColouringOptions options;
    options.min_support = 0;
    expect_same(options, scene.colouring_views(), 0.005);
}

TEST_F(CudaColouring, RoundingEqualsCpuForm) {
    ColouringOptions options;
    options.max_colour_difference_std = 0;
    expect_same(options, scene.colouring_views(), 0.005);
    options.support_edge_m = 0.15f;  // radius 6
    expect_same(options, scene.colouring_views(), 0.005);
}

// More rounds than the device makes between two waits.
TEST_F(CudaColouring, ManyRoundsEqualCpuForm) {
    ColouringOptions options;
    options.max_rounds = 40;
    options.min_ray_length_m = 0.02f;
    options.min_support = 0.5f;
    expect_same(options, scene.colouring_views(), 0.005);
    VoxelVolume volume = hull;
    ColouringReport report;
    make_voxel_colourer(testing::tested_gpu(), options)->colour(scene.colouring_views(), volume, report);
    EXPECT_GT(report.rounds, 16);
}

// One carver and one colourer, from a volume of few bricks to one of many and back.
TEST_F(CudaColouring, VolumesOfAllSizesEqualCpuForm) {
    auto carver = make_hull_carver(testing::tested_gpu());
    auto colourer = make_voxel_colourer(testing::tested_gpu());
    for (const float voxel_m : {0.04f, 0.008f, 0.02f}) {
        const int n = static_cast<int>(1.2f / voxel_m) / 8 * 8;
        VoxelVolume cpu, gpu;
        ColouringReport cpu_report, gpu_report;
        make_hull_carver(Device::kCpu)->carve(scene.hull_views(), make_lattice(voxel_m, n, n, n), cpu);
        carver->carve(scene.hull_views(), make_lattice(voxel_m, n, n, n), gpu);
        EXPECT_EQ(compare(cpu, gpu).second, 0u) << voxel_m;
        make_voxel_colourer(Device::kCpu)->colour(scene.colouring_views(), cpu, cpu_report);
        colourer->colour(scene.colouring_views(), gpu, gpu_report);
        EXPECT_EQ(compare(cpu, gpu).second, 0u) << voxel_m;
        EXPECT_EQ(cpu.colours, gpu.colours) << voxel_m;
        EXPECT_EQ(cpu_report.carved, gpu_report.carved) << voxel_m;
    }
}

TEST_F(CudaColouring, AllStepsEqualCpuFormWithAbsentViews) {
    auto views = scene.colouring_views();
    views[1].image = {};
    views[2].sharp = nullptr;
    views[3].sharp = views[3].silhouette = nullptr;
    std::vector<std::uint8_t> grey(static_cast<std::size_t>(scene.cameras[4].width) *
                                   scene.cameras[4].height);
    for (std::size_t n = 0; n < grey.size(); ++n) grey[n] = scene.images[4][3 * n + 1];
    views[4].image = {grey.data(), scene.cameras[4].width, scene.cameras[4].height, 1,
                      scene.cameras[4].width};
    expect_same({}, views, 0.01);
}

TEST_F(CudaColouring, HandlesEmptyAndRejectsInvalidInput) {
    auto colourer = make_voxel_colourer(testing::tested_gpu());
    VoxelVolume nothing;
    nothing.lattice = make_lattice(0.02f, 32, 32, 32);
    ColouringReport report;
    colourer->colour(scene.colouring_views(), nothing, report);
    EXPECT_TRUE(nothing.colours.empty());
    for (float iou : report.silhouette_iou) EXPECT_EQ(iou, 0.f);
    VoxelVolume volume = hull;
    colourer->colour({}, volume, report);
    EXPECT_FALSE(volume.colours.empty());
    for (auto& mask : scene.masks) std::fill(mask.begin(), mask.end(), std::uint8_t{0});
    volume = hull;
    colourer->colour(scene.colouring_views(), volume, report);  // everything is carved
    EXPECT_TRUE(volume.bricks.empty());
    auto views = scene.colouring_views();
    views[1].image.width = 17;
    volume = hull;
    EXPECT_THROW(colourer->colour(views, volume, report), std::invalid_argument);
}

}  // namespace
}  // namespace kinevox::kernels
