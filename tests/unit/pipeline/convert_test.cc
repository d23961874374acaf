#include "server/pipeline/convert.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>
#include <tuple>

namespace kinevox {
namespace {

using Voxels = std::set<std::tuple<int, int, int>>;

// Some thousand voxels scattered over a lattice whose size is no multiple of four bricks.
kernels::VoxelVolume scattered(double share) {
    kernels::VoxelVolume volume;
    volume.lattice = {{-0.4f, 0.8f, 0.f}, 0.01f, {72, 40, 104}};
    std::mt19937 random(7);
    std::bernoulli_distribution brick_there(0.4), voxel_there(share);
    for (int z = 0; z < 13; ++z)
        for (int y = 0; y < 5; ++y)
            for (int x = 0; x < 9; ++x) {
                if (!brick_there(random)) continue;
                kernels::Brick brick;
                brick.x = static_cast<std::int16_t>(x), brick.y = static_cast<std::int16_t>(y);
                brick.z = static_cast<std::int16_t>(z);
                bool any = false;
                for (auto& layer : brick.occupancy)
                    for (int bit = 0; bit < 64; ++bit)
                        if (voxel_there(random)) layer |= std::uint64_t{1} << bit, any = true;
                if (any) volume.bricks.push_back(brick);
            }
    return volume;
}

Voxels voxels_of(const kernels::VoxelVolume& volume) {
    Voxels voxels;
    for (const kernels::Brick& brick : volume.bricks)
        for (int z = 0; z < 8; ++z)
            for (int bit = 0; bit < 64; ++bit)
                if (brick.occupancy[z] >> bit & 1)
                    voxels.insert({8 * brick.x + bit % 8, 8 * brick.y + bit / 8, 8 * brick.z + z});
    return voxels;
}

TEST(Convert, OccupiesCoarseVoxelIfAnyIs) {
    const kernels::VoxelVolume volume = scattered(0.01);
    Voxels expected;
    for (const auto& [x, y, z] : voxels_of(volume)) expected.insert({x / 4, y / 4, z / 4});
    kernels::VoxelVolume coarse;
    coarsen_by_four(volume, coarse);
    EXPECT_EQ(voxels_of(coarse), expected);
    EXPECT_FLOAT_EQ(coarse.lattice.voxel_m, 0.04f);
    EXPECT_EQ(coarse.lattice.size[0], 24);  // 9 bricks: 3 coarse ones
    EXPECT_EQ(coarse.lattice.size[1], 16);
    EXPECT_EQ(coarse.lattice.size[2], 32);
}

TEST(Convert, ReturnsCentreOfVoxels) {
    const kernels::VoxelVolume volume = scattered(0.3);
    Vec3 sum;
    const Voxels voxels = voxels_of(volume);
    for (const auto& [x, y, z] : voxels) sum += Vec3{x + 0.5, y + 0.5, z + 0.5};
    const Vec3 exact = Vec3{-0.4, 0.8, 0} + (0.01 / static_cast<double>(voxels.size())) * sum;
    const auto centre = centre_of(volume);
    ASSERT_TRUE(centre);
    EXPECT_LT(norm(*centre - exact), 0.005);
    EXPECT_FALSE(centre_of({}));
}

TEST(Convert, FindsHeightBelowWhichLegsAreMissing) {
    kernels::VoxelVolume volume;
    volume.lattice.voxel_m = 0.01f;
    volume.lattice.origin[2] = -0.08f;
    const auto standing_on = [&](std::initializer_list<int> layers) {  // and a trunk from 0.80 to 1.68 m
        volume.bricks.clear();
        kernels::Brick full{};
        std::ranges::fill(full.occupancy, ~std::uint64_t{0});
        for (int z = 11; z < 22; ++z) full.z = static_cast<std::int16_t>(z), volume.bricks.push_back(full);
        for (const int z : layers) full.z = static_cast<std::int16_t>(z), volume.bricks.push_back(full);
        return legs_missing_below(volume);
    };
    EXPECT_NEAR(standing_on({1, 2, 3, 4, 5, 6, 7, 8, 9, 10}), 0, 1e-6);
    EXPECT_NEAR(standing_on({7, 8, 9, 10}), 0.48, 1e-6) << "shanks";
    EXPECT_NEAR(standing_on({1, 2, 3, 4, 5}), 0.80, 1e-6) << "thighs";
    EXPECT_NEAR(standing_on({}), 0.80, 1e-6);
    kernels::Brick stray{};
    stray.z = 3, stray.occupancy[3] = 1;
    volume.bricks.push_back(stray);
    EXPECT_NEAR(legs_missing_below(volume), 0.80, 1e-6) << "stray voxels are no legs";
    EXPECT_EQ(legs_missing_below({}), 0);
}

TEST(Convert, KeepsVoxelsAndColours) {
    kernels::VoxelVolume volume = scattered(0.1);
    volume.colours = {{1, 2, 3}, {4, 5, 6}};
    const Volume common = to_common(volume);
    ASSERT_EQ(common.bricks.size(), volume.bricks.size());
    std::int64_t count = static_cast<std::int64_t>(voxels_of(volume).size());
    EXPECT_EQ(voxel_count(common), count);
    EXPECT_EQ(common.bricks.back().z, volume.bricks.back().z);
    EXPECT_EQ(common.bricks.back().occupancy[3], volume.bricks.back().occupancy[3]);
    EXPECT_EQ(common.grid.voxel_m, 0.01);
    EXPECT_EQ(common.grid.origin_in_world, (Vec3{-0.4, 0.8, 0}));
    EXPECT_EQ(common.colours[1], (Rgb{4, 5, 6}));
}

}  // namespace
}  // namespace kinevox
