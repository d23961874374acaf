#include "common/volume.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <tuple>

#include "tests/support/person_volume.h"

namespace kinevox {
namespace {

// The scalar reference: voxels in a map.
using Key = std::tuple<int, int, int>;  // k, j, i
using Dense = std::map<Key, bool>;

Dense dense_from(const Volume& volume) {
    Dense dense;
    for (const VolumeBrick& b : volume.bricks)
        for (int z = 0; z < 8; ++z)
            for (int y = 0; y < 8; ++y)
                for (int x = 0; x < 8; ++x)
                    if (b.occupancy[z] >> (y * 8 + x) & 1)
                        dense[{b.z * 8 + z, b.y * 8 + y, b.x * 8 + x}] = true;
    return dense;
}

bool is_surface(const Dense& dense, const Key& key) {
    const auto [k, j, i] = key;
    return !(dense.contains({k, j, i - 1}) && dense.contains({k, j, i + 1}) &&
             dense.contains({k, j - 1, i}) && dense.contains({k, j + 1, i}) &&
             dense.contains({k - 1, j, i}) && dense.contains({k + 1, j, i}));
}

// Blobs that touch every border of the grid, so that bricks have neighbours on all sides and none.
Volume ragged_volume(unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> anywhere(-0.02, 0.34), radius(0.02, 0.09);
    std::vector<std::pair<Vec3, double>> balls;
    for (int i = 0; i < 12; ++i)
        balls.push_back({{anywhere(random), anywhere(random), anywhere(random)}, radius(random)});
    Volume volume = testing::volume_of({{0, 0, 0}, 0.01, {24, 32, 40}}, [&](Vec3 p) {
        for (const auto& [centre, r] : balls)
            if (norm(p - centre) < r) return true;
        return false;
    });
    for (std::size_t i = surface_voxels(volume).size(); i > 0; --i)
        volume.colours.push_back({static_cast<std::uint8_t>(random()), static_cast<std::uint8_t>(random()),
                                  static_cast<std::uint8_t>(random())});
    return volume;
}

TEST(Volume, SurfaceMatchesItsDefinition) {
    for (unsigned seed = 0; seed < 5; ++seed) {
        const Volume volume = ragged_volume(seed);
        const Dense dense = dense_from(volume);
        ASSERT_EQ(voxel_count(volume), static_cast<std::int64_t>(dense.size()));
        std::size_t expected = 0;
        for (const auto& [key, occupied] : dense) expected += is_surface(dense, key);
        const std::vector<VoxelIndex> surface = surface_voxels(volume);
        EXPECT_EQ(surface.size(), expected);
        for (const VoxelIndex v : surface) EXPECT_TRUE(is_surface(dense, {v.k, v.j, v.i}));
    }
}

TEST(Volume, CoarseVoxelsAreHalfFullWithMeanColours) {
    const Volume fine = ragged_volume(3);
    const Volume coarse = coarsened(fine, 1);
    ASSERT_EQ(volume_problem(coarse), "");
    EXPECT_EQ(coarse.grid.voxel_m, 0.02);
    EXPECT_EQ(coarse.grid.size, (std::array{16, 16, 24}));

    std::map<Key, int> children;
    for (const auto& [key, occupied] : dense_from(fine)) {
        const auto [k, j, i] = key;
        ++children[{k / 2, j / 2, i / 2}];
    }
    Dense expected;
    for (const auto& [key, count] : children)
        if (count >= 4) expected[key] = true;
    EXPECT_EQ(dense_from(coarse), expected);

    std::map<Key, std::array<int, 4>> sums;
    const std::vector<VoxelIndex> fine_surface = surface_voxels(fine);
    for (std::size_t n = 0; n < fine_surface.size(); ++n) {
        const VoxelIndex v = fine_surface[n];
        auto& sum = sums[{v.k / 2, v.j / 2, v.i / 2}];
        sum[0] += fine.colours[n].r, sum[1] += fine.colours[n].g, sum[2] += fine.colours[n].b, ++sum[3];
    }
    const std::vector<VoxelIndex> coarse_surface = surface_voxels(coarse);
    ASSERT_EQ(coarse.colours.size(), coarse_surface.size());
    for (std::size_t n = 0; n < coarse_surface.size(); ++n) {
        const VoxelIndex v = coarse_surface[n];
        const auto sum = sums.at({v.k, v.j, v.i});
        ASSERT_GT(sum[3], 0);
        EXPECT_NEAR(coarse.colours[n].r, double(sum[0]) / sum[3], 0.5);
        EXPECT_NEAR(coarse.colours[n].b, double(sum[2]) / sum[3], 0.5);
    }
}

TEST(Volume, KeepsItsSizeWhenCoarsened) {
    const Volume person = testing::person_volume(0.01);
    EXPECT_NEAR(volume_litres(person), voxel_count(person) * 1e-3, 1e-6);  // a voxel is a millilitre
    for (int levels = 0; levels <= 3; ++levels) {
        const Volume coarse = coarsened(person, levels);
        EXPECT_EQ(volume_problem(coarse), "");
        EXPECT_EQ(coarse.colours.size(), surface_voxels(coarse).size());
        // Voxels that are just half full count, so coarse limbs are a little thick.
        EXPECT_NEAR(volume_litres(coarse) / volume_litres(person), 1, 0.01 + 0.05 * levels) << levels;
    }
}

TEST(Volume, MortonOrderRoundTrips) {
    for (int y = 0; y < 8; ++y)
        for (int x = 0; x < 8; ++x) {
            int morton = 0;
            for (int bit = 0; bit < 3; ++bit)
                morton |= (x >> bit & 1) << (2 * bit) | (y >> bit & 1) << (2 * bit + 1);
            const std::uint64_t slice = std::uint64_t{1} << (y * 8 + x);
            EXPECT_EQ(volume_bits::morton_from_slice(slice), std::uint64_t{1} << morton);
            EXPECT_EQ(volume_bits::slice_from_morton(std::uint64_t{1} << morton), slice);
        }
}

TEST(Volume, NamesTheProblem) {
    Volume volume = ragged_volume(0);
    EXPECT_EQ(volume_problem(volume), "");
    std::swap(volume.bricks[0], volume.bricks[1]);
    EXPECT_NE(volume_problem(volume).find("out of order"), std::string::npos);
    std::swap(volume.bricks[0], volume.bricks[1]);
    volume.bricks.back().z = 5;
    EXPECT_NE(volume_problem(volume).find("outside the grid"), std::string::npos);
    volume.grid.size[0] = 12;
    EXPECT_NE(volume_problem(volume).find("multiple of 8"), std::string::npos);
}

}  // namespace
}  // namespace kinevox
