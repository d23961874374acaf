// The carver against a voxel-by-voxel reference that knows nothing of blocks, cells and vectors.
#include "kernels/hull.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

#include "kernels/cpu/hull_maps.h"
#include "kernels/cpu/surrounded.h"
#include "kernels/tests/volume_scene.h"

namespace kinevox::kernels {
namespace {

using testing::bits_of;
using testing::box_distance;
using testing::make_lattice;
using testing::ring_of_cameras;
using testing::Scene;
using testing::sphere_distance;

// OpenCV's projection in double precision; false behind the camera.
bool project(const CameraModel& c, const double* p, double& u, double& v) {
    const float* r = c.rotation_camera_from_world;
    const float* t = c.translation_camera_from_world;
    const double x = r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + t[0];
    const double y = r[3] * p[0] + r[4] * p[1] + r[5] * p[2] + t[1];
    const double z = r[6] * p[0] + r[7] * p[1] + r[8] * p[2] + t[2];
    if (z < 0.05) return false;
    const double a = x / z, b = y / z, r2 = a * a + b * b;
    const double radial = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
    u = c.fx * (a * radial + 2 * c.p1 * a * b + c.p2 * (r2 + 2 * a * a)) + c.cx;
    v = c.fy * (b * radial + c.p1 * (r2 + 2 * b * b) + 2 * c.p2 * a * b) + c.cy;
    return true;
}

// 1 inside, 0 outside, 2 where rounding may decide either way (a pixel border nearer than 0.01 px).
std::vector<std::uint8_t> reference_hull(const Scene& scene, const Lattice& lattice, int min_views) {
    std::vector<std::uint8_t> out;
    for (int k = 0; k < lattice.size[2]; ++k)
        for (int j = 0; j < lattice.size[1]; ++j)
            for (int i = 0; i < lattice.size[0]; ++i) {
                const int ijk[3] = {i, j, k};
                double p[3];
                for (int axis = 0; axis < 3; ++axis)
                    p[axis] = static_cast<double>(lattice.origin[axis]) + (ijk[axis] + 0.5) * lattice.voxel_m;
                int contain = 0;
                bool outside = false, close = false;
                for (std::size_t n = 0; n < scene.cameras.size(); ++n) {
                    if (scene.masks[n].empty()) continue;
                    const CameraModel& c = scene.cameras[n];
                    double u, v;
                    if (!project(c, p, u, v)) continue;
                    const double at_u = u + 0.5 - std::floor(u + 0.5), at_v = v + 0.5 - std::floor(v + 0.5);
                    close |= std::min({at_u, 1 - at_u, at_v, 1 - at_v}) < 0.01;
                    const int column = static_cast<int>(std::floor(u + 0.5)),
                              row = static_cast<int>(std::floor(v + 0.5));
                    if (column < 0 || row < 0 || column >= c.width || row >= c.height) continue;
                    ++contain;
                    outside |= scene.masks[n][static_cast<std::size_t>(row) * c.width + column] == 0;
                }
                out.push_back(close ? 2 : (!outside && contain >= min_views ? 1 : 0));
            }
    return out;
}

void expect_equal(const std::vector<std::uint8_t>& is, const std::vector<std::uint8_t>& should) {
    ASSERT_EQ(is.size(), should.size());
    std::size_t different = 0, filled = 0, undecided = 0;
    for (std::size_t n = 0; n < is.size(); ++n) {
        if (should[n] == 2) {
            ++undecided;
            continue;
        }
        different += is[n] != should[n];
        filled += should[n];
    }
    EXPECT_EQ(different, 0u);
    EXPECT_GT(filled, 100u);
    EXPECT_LT(undecided, is.size() / 4);
}

struct HullCase {
    const char* name;
    int cameras;
    float k1, k2, p1;
    float voxel_m;
    int size[3];
    bool box;
};

class HullAgainstReference : public ::testing::TestWithParam<HullCase> {};

TEST_P(HullAgainstReference, EqualsReferenceForEachVoxel) {
    const HullCase& param = GetParam();
    Scene scene = ring_of_cameras(param.cameras, param.k1, param.k2, param.p1);
    scene.draw([&](const float* p) {
        return param.box ? box_distance(p, 0.21f, 0.13f, 0.35f) : sphere_distance(p, 0, 0, 1.f, 0.3f);
    });
    const Lattice lattice = make_lattice(param.voxel_m, param.size[0], param.size[1], param.size[2]);
    VoxelVolume volume;
    make_hull_carver(Device::kCpu)->carve(scene.hull_views(), lattice, volume);
    EXPECT_TRUE(volume.colours.empty());
    EXPECT_EQ(volume.lattice, lattice);
    expect_equal(bits_of(volume), reference_hull(scene, lattice, 2));
}

INSTANTIATE_TEST_SUITE_P(
    Shapes, HullAgainstReference,
    ::testing::Values(HullCase{"four", 4, 0, 0, 0, 0.02f, {48, 48, 56}, false},
                      HullCase{"distorted", 4, -0.2f, 0.08f, 0.0004f, 0.02f, {48, 48, 56}, false},
                      HullCase{"distorted_box", 3, 0.1f, -0.05f, -0.001f, 0.015f, {72, 40, 64}, true},
                      HullCase{"fine", 5, 0, 0, 0, 0.009f, {88, 80, 96}, true},
                      HullCase{"coarse_and_odd", 4, -0.1f, 0, 0, 0.05f, {8, 24, 16}, false}),
    [](const auto& info) { return info.param.name; });

TEST(Hull, OnlyCamerasThatSeeAVoxelCarveIt) {
    Scene scene = ring_of_cameras(4, 0, 0, 0);
    scene.cameras[1].cx -= 330;  // the body leaves this image at the left
    scene.draw([](const float* p) { return sphere_distance(p, 0, 0, 1.f, 0.3f); });
    const Lattice lattice = make_lattice(0.02f, 48, 48, 48);
    for (int min_views : {1, 2, 4}) {
        VoxelVolume volume;
        HullOptions options;
        options.min_views = min_views;
        make_hull_carver(Device::kCpu, options)->carve(scene.hull_views(), lattice, volume);
        if (min_views == 4) {
            const auto is = bits_of(volume), should = reference_hull(scene, lattice, min_views);
            for (std::size_t n = 0; n < is.size(); ++n)
                ASSERT_TRUE(should[n] == 2 || is[n] == should[n]) << n;
        } else {
            expect_equal(bits_of(volume), reference_hull(scene, lattice, min_views));
        }
    }
}

TEST(Hull, AbsentViewDoesNotVote) {
    Scene scene = ring_of_cameras(4, 0, 0, 0);
    scene.draw([](const float* p) { return sphere_distance(p, 0, 0, 1.f, 0.25f); });
    scene.masks[2].clear();
    const Lattice lattice = make_lattice(0.02f, 48, 48, 48);
    VoxelVolume volume;
    make_hull_carver(Device::kCpu)->carve(scene.hull_views(), lattice, volume);
    expect_equal(bits_of(volume), reference_hull(scene, lattice, 2));
}

TEST(Hull, EmptySilhouetteClearsFullOnesFill) {
    Scene scene = ring_of_cameras(4, 0, 0, 0);
    scene.draw([](const float*) { return -1.f; });  // everything is foreground
    const Lattice lattice = make_lattice(0.02f, 32, 24, 40);
    VoxelVolume volume;
    make_hull_carver(Device::kCpu)->carve(scene.hull_views(), lattice, volume);
    expect_equal(bits_of(volume), reference_hull(scene, lattice, 2));
    std::fill(scene.masks[3].begin(), scene.masks[3].end(), std::uint8_t{0});
    make_hull_carver(Device::kCpu)->carve(scene.hull_views(), lattice, volume);
    EXPECT_TRUE(volume.bricks.empty());
    make_hull_carver(Device::kCpu)->carve({}, lattice, volume);
    EXPECT_TRUE(volume.bricks.empty());
}

// A hole of 7 px in one silhouette drills through the whole body; it is filled again, and no more.
TEST(Hull, HoleInOneSilhouetteLeavesNoTunnel) {
    Scene scene = ring_of_cameras(4, 0, 0, 0);
    scene.draw([](const float* p) { return sphere_distance(p, 0, 0, 1.f, 0.3f); });
    const Lattice lattice = make_lattice(0.01f, 96, 96, 96);
    HullOptions plain;
    plain.fill_radius_m = 0;
    VoxelVolume whole, tunnel, filled;
    make_hull_carver(Device::kCpu, plain)->carve(scene.hull_views(), lattice, whole);
    const int width = scene.cameras[0].width;
    for (int y = 237; y < 244; ++y) {
        for (int x = 310; x < 317; ++x) scene.masks[0][static_cast<std::size_t>(y) * width + x] = 0;
    }
    make_hull_carver(Device::kCpu, plain)->carve(scene.hull_views(), lattice, tunnel);
    make_hull_carver(Device::kCpu)->carve(scene.hull_views(), lattice, filled);
    const auto before = bits_of(whole), drilled = bits_of(tunnel), after = bits_of(filled);
    std::size_t lost = 0, missing = 0;
    for (std::size_t n = 0; n < before.size(); ++n) {
        lost += before[n] && !drilled[n];
        missing += before[n] && !after[n];
        ASSERT_TRUE(after[n] == 0 || before[n]) << "filled beyond the body";
    }
    EXPECT_GT(lost, 500u);
    EXPECT_LT(missing, lost / 5);
}

// The same as the words say, voxel by voxel.
TEST(Hull, FillsSurroundedVoxels) {
    const Lattice lattice = make_lattice(0.02f, 24, 16, 32);
    std::mt19937 random(5);
    std::vector<std::uint8_t> bits(static_cast<std::size_t>(24) * 16 * 32);
    for (std::uint8_t& bit : bits) bit = random() % 6 == 0;
    VoxelVolume volume;
    volume.lattice = lattice;
    for (int n = 0; n < 3 * 2 * 4; ++n) {
        if (n == 7) continue;  // a brick that is absent
        Brick brick;
        brick.x = static_cast<std::int16_t>(n % 3);
        brick.y = static_cast<std::int16_t>(n / 3 % 2);
        brick.z = static_cast<std::int16_t>(n / 6);
        for (int bit = 0; bit < kBrickVoxels; ++bit) {
            const int x = brick.x * 8 + (bit & 7), y = brick.y * 8 + (bit >> 3 & 7),
                      z = brick.z * 8 + (bit >> 6);
            if (bits[(static_cast<std::size_t>(z) * 16 + y) * 24 + x])
                brick.occupancy[bit >> 6] |= std::uint64_t{1} << (bit & 63);
        }
        volume.bricks.push_back(brick);
    }
    bits = bits_of(volume);
    const auto at = [&](int x, int y, int z) {
        if (x < 0 || y < 0 || z < 0 || x >= 24 || y >= 16 || z >= 32) return false;
        return bits[(static_cast<std::size_t>(z) * 16 + y) * 24 + x] != 0;
    };
    for (int radius : {1, 4, 8}) {
        for (int least : {2, 5, 6, 7}) {
            VoxelVolume is = volume;
            HoleFiller filler;
            const std::int64_t filled = filler.fill(is, 0.02f * static_cast<float>(radius), least);
            const auto out = bits_of(is);
            std::int64_t count = 0;
            for (std::size_t n = 0; n < bits.size(); ++n) {
                const int voxel = static_cast<int>(n), x = voxel % 24, y = voxel / 24 % 16, z = voxel / 384;
                int lines = 0;
                for (int line = 0; line < kFillLines; ++line) {
                    int d[3];
                    fill_line(line, d);
                    bool before = false, after = false;
                    for (int s = 1; s <= fill_steps(line, radius); ++s) {
                        before = before || at(x - s * d[0], y - s * d[1], z - s * d[2]);
                        after = after || at(x + s * d[0], y + s * d[1], z + s * d[2]);
                    }
                    lines += before && after;
                }
                const bool absent = x / 8 == 1 && y / 8 == 0 && z / 8 == 1;
                const bool should = bits[n] || (lines >= least && !absent);
                ASSERT_EQ(out[n] != 0, should)
                    << "radius " << radius << ", at least " << least << ", voxel " << n;
                count += should && !bits[n];
            }
            EXPECT_EQ(filled, count);
        }
    }
}

TEST(Hull, BudgetToleratesSmallMissOfOneCamera) {
    Scene scene = ring_of_cameras(4, 0, 0, 0);
    scene.draw([](const float* p) { return sphere_distance(p, 0, 0, 1.f, 0.3f); });
    VoxelVolume exact, shifted, rescued;
    const Lattice lattice = make_lattice(0.01f, 96, 96, 96);
    make_hull_carver(Device::kCpu)->carve(scene.hull_views(), lattice, exact);
    scene.cameras[0].cx += 3;  // a calibration that is 3 px off
    make_hull_carver(Device::kCpu)->carve(scene.hull_views(), lattice, shifted);
    HullOptions options;
    options.miss_budget_permille = 5;  // 3 of 640 px
    make_hull_carver(Device::kCpu, options)->carve(scene.hull_views(), lattice, rescued);
    const auto full = bits_of(exact), lost = bits_of(shifted), kept = bits_of(rescued);
    std::size_t lost_count = 0, missing = 0, kept_count = 0, full_count = 0;
    for (std::size_t n = 0; n < full.size(); ++n) {
        full_count += full[n];
        kept_count += kept[n];
        lost_count += full[n] && !lost[n];
        missing += full[n] && !kept[n];
    }
    EXPECT_GT(lost_count, full_count / 100);
    EXPECT_EQ(missing, 0u);
    EXPECT_LT(kept_count, full_count * 5 / 4);  // dilating every silhouette by 3 px would add more
}

TEST(Hull, MissMapHoldsChessboardDistances) {
    const int width = 40, height = 30;
    std::vector<std::uint8_t> mask(width * height, 0);
    mask[12 * width + 15] = mask[13 * width + 15] = mask[20 * width + 30] = 255;
    CameraModel camera;
    camera.width = width, camera.height = height, camera.fx = camera.fy = 100;
    HullMapsStorage storage;
    make_hull_maps({&camera, mask.data(), {15, 12, 31, 21}}, make_projector(camera, "test"), 101, 1, storage);
    const HullMaps& maps = storage.maps;
    ASSERT_EQ(maps.budget_px, 4);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            int distance = 1000;
            for (int b = 0; b < height; ++b)
                for (int a = 0; a < width; ++a)
                    if (mask[b * width + a])
                        distance = std::min(distance, std::max(std::abs(a - x), std::abs(b - y)));
            ASSERT_EQ(miss_at(maps, static_cast<float>(x), static_cast<float>(y)),
                      maps.miss_of_distance(distance))
                << x << " " << y;
        }
}

TEST(Hull, RejectsInvalidInputByName) {
    using ::testing::HasSubstr;
    using ::testing::ThrowsMessage;
    Scene scene = ring_of_cameras(2, 0, 0, 0);
    scene.draw([](const float* p) { return sphere_distance(p, 0, 0, 1.f, 0.3f); });
    VoxelVolume volume;
    auto carver = make_hull_carver(Device::kCpu);
    EXPECT_THAT([&] { carver->carve(scene.hull_views(), make_lattice(0.02f, 12, 8, 8), volume); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("size 12")));
    EXPECT_THAT([&] { carver->carve(scene.hull_views(), make_lattice(0, 8, 8, 8), volume); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("voxel_m")));
    scene.cameras[1].fx = NAN;
    EXPECT_THAT([&] { carver->carve(scene.hull_views(), make_lattice(0.02f, 8, 8, 8), volume); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("not finite")));
    HullOptions options;
    options.min_views = 0;
    EXPECT_THAT(options.check(), HasSubstr("min_views"));
    EXPECT_THROW(make_hull_carver(Device::kCpu, options), std::invalid_argument);
}

}  // namespace
}  // namespace kinevox::kernels
