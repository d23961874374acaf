// Colours, occlusion and each of the three kinds of carving on bodies whose truth is known.
#include "kernels/colouring.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

#include "kernels/cpu/colouring_steps.h"
#include "kernels/cpu/surface.h"
#include "kernels/projection.h"
#include "kernels/tests/volume_scene.h"

#ifdef KINEVOX_HAVE_TBB
#include <oneapi/tbb/global_control.h>
#endif

namespace kinevox::kernels {
namespace {

using testing::bits_of;
using testing::make_lattice;
using testing::ring_of_cameras;
using testing::Scene;
using testing::sphere_distance;

using Inside = std::function<bool(const float*)>;

VoxelVolume volume_of(const Lattice& lattice, const Inside& inside) {
    VoxelVolume volume;
    volume.lattice = lattice;
    for (int z = 0; z < lattice.size[2] / 8; ++z)
        for (int y = 0; y < lattice.size[1] / 8; ++y)
            for (int x = 0; x < lattice.size[0] / 8; ++x) {
                Brick brick;
                brick.x = static_cast<std::int16_t>(x);
                brick.y = static_cast<std::int16_t>(y);
                brick.z = static_cast<std::int16_t>(z);
                bool any = false;
                for (int bit = 0; bit < kBrickVoxels; ++bit) {
                    const int ijk[3] = {x * 8 + (bit & 7), y * 8 + (bit >> 3 & 7), z * 8 + (bit >> 6)};
                    float p[3];
                    for (int axis = 0; axis < 3; ++axis)
                        p[axis] =
                            lattice.origin[axis] + (static_cast<float>(ijk[axis]) + 0.5f) * lattice.voxel_m;
                    if (!inside(p)) continue;
                    brick.occupancy[bit >> 6] |= std::uint64_t{1} << (bit & 63);
                    any = true;
                }
                if (any) volume.bricks.push_back(brick);
            }
    return volume;
}

// How many voxels for which `where` holds are still set.
std::size_t count(const VoxelVolume& volume, const Inside& where) {
    std::size_t n = 0;
    const auto bits = bits_of(volume);
    const int* size = volume.lattice.size;
    for (std::size_t at = 0; at < bits.size(); ++at) {
        if (!bits[at]) continue;
        const int ijk[3] = {static_cast<int>(at % size[0]), static_cast<int>(at / size[0] % size[1]),
                            static_cast<int>(at / size[0] / size[1])};
        float p[3];
        for (int axis = 0; axis < 3; ++axis)
            p[axis] =
                volume.lattice.origin[axis] + (static_cast<float>(ijk[axis]) + 0.5f) * volume.lattice.voxel_m;
        n += where(p);
    }
    return n;
}

ColouringOptions only_paint() {
    ColouringOptions options;
    options.max_rounds = 0;
    return options;
}

Colour checks(const float* p) {  // patches of about 12 cm in clearly different colours
    const int a = static_cast<int>(std::floor(p[0] / 0.12f)), b = static_cast<int>(std::floor(p[1] / 0.12f)),
              c = static_cast<int>(std::floor(p[2] / 0.12f));
    const int n = ((a * 7 + b * 3 + c * 5) % 4 + 4) % 4;
    constexpr Colour kPalette[4] = {{220, 40, 40}, {40, 200, 60}, {50, 60, 220}, {230, 220, 90}};
    return kPalette[n];
}

TEST(Surface, MatchesDefinitionForEachVoxel) {
    const Lattice lattice = make_lattice(0.02f, 24, 16, 32);
    std::mt19937 random(3);
    const VoxelVolume volume = volume_of(lattice, [&](const float* p) {
        return sphere_distance(p, 0.02f, 0, 1.03f, 0.2f) < 0 && random() % 10 != 0;
    });
    BrickGrid grid;
    grid.build(volume);
    Surface surface;
    surface.build(volume, grid);
    const auto bits = bits_of(volume);
    const int* size = lattice.size;
    const auto at = [&](int x, int y, int z) {
        const bool in = x >= 0 && y >= 0 && z >= 0 && x < size[0] && y < size[1] && z < size[2];
        return in && bits[(static_cast<std::size_t>(z) * size[1] + y) * size[0] + x];
    };
    std::size_t expected = 0;
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y)
            for (int x = 0; x < size[0]; ++x)
                expected += at(x, y, z) && !(at(x - 1, y, z) && at(x + 1, y, z) && at(x, y - 1, z) &&
                                             at(x, y + 1, z) && at(x, y, z - 1) && at(x, y, z + 1));
    ASSERT_EQ(surface.size(), static_cast<int>(expected));
    for (int b = 0; b < static_cast<int>(volume.bricks.size()); ++b) {
        for (int n = surface.first[b]; n < surface.first[b + 1]; ++n) {
            const Brick& brick = volume.bricks[b];
            const int bit = surface.bit[n];
            const int x = brick.x * 8 + (bit & 7), y = brick.y * 8 + (bit >> 3 & 7),
                      z = brick.z * 8 + (bit >> 6);
            ASSERT_TRUE(at(x, y, z));
            const auto empty = [&](int dx, int dy, int dz) { return at(x + dx, y + dy, z + dz) ? 0u : 1u; };
            const unsigned open = empty(-1, 0, 0) | empty(1, 0, 0) << 1 | empty(0, -1, 0) << 2 |
                                  empty(0, 1, 0) << 3 | empty(0, 0, -1) << 4 | empty(0, 0, 1) << 5;
            ASSERT_EQ(surface.open[n], open);
            ASSERT_NEAR(surface.x_m[n], lattice.origin[0] + (x + 0.5f) * lattice.voxel_m, 1e-5f);
            ASSERT_NEAR(surface.y_m[n], lattice.origin[1] + (y + 0.5f) * lattice.voxel_m, 1e-5f);
            ASSERT_NEAR(surface.z_m[n], lattice.origin[2] + (z + 0.5f) * lattice.voxel_m, 1e-5f);
            if (n > surface.first[b]) {
                ASSERT_LT(surface.bit[n - 1], bit);
            }
        }
    }
    for (int radius = 1; radius <= kMaxSupportRadius; ++radius) {
        const int brick = static_cast<int>(volume.bricks.size()) / 2;
        const Brick& b = volume.bricks[brick];
        const int edge = 2 * radius + 1, all = edge * edge * edge;
        std::uint64_t thin[5][kBrickEdge];
        const int least[5] = {0, all / 3, all / 2, all * 47 / 100, all + 1};
        for (int n = 0; n < 5; ++n) find_unsupported(volume, grid, brick, radius, least[n], thin[n]);
        for (int bit = 0; bit < kBrickVoxels; ++bit) {
            int sum = 0;
            for (int dz = -radius; dz <= radius; ++dz)
                for (int dy = -radius; dy <= radius; ++dy)
                    for (int dx = -radius; dx <= radius; ++dx)
                        sum += at(b.x * 8 + (bit & 7) + dx, b.y * 8 + (bit >> 3 & 7) + dy,
                                  b.z * 8 + (bit >> 6) + dz);
            for (int n = 0; n < 5; ++n) {
                ASSERT_EQ(thin[n][bit >> 6] >> (bit & 63) & 1, sum < least[n] ? 1u : 0u)
                    << "radius " << radius << " bit " << bit << " has " << sum << " of " << least[n];
            }
        }
    }
}

// A red and a green sphere, each hidden from one camera by the other: no colour may shine through.
TEST(Colouring, HiddenSurfacesIgnoreOccluders) {
    Scene scene = ring_of_cameras(4, -0.1f, 0.02f, 0);
    const float ax = 0.45f * std::cos(0.2f), ay = 0.45f * std::sin(0.2f);  // along the first camera's axis
    const auto red = [&](const float* p) { return sphere_distance(p, ax, ay, 1, 0.2f); };
    const auto green = [&](const float* p) { return sphere_distance(p, -ax, -ay, 1, 0.2f); };
    scene.draw([&](const float* p) { return std::min(red(p), green(p)); },
               [&](const float* p) {
                   return red(p) < green(p) ? Colour{220, 30, 30} : Colour{30, 200, 30};
               });
    const Lattice lattice = make_lattice(0.01f, 160, 96, 64);
    VoxelVolume volume = volume_of(lattice, [&](const float* p) { return std::min(red(p), green(p)) < 0; });
    ColouringReport report;
    make_voxel_colourer(Device::kCpu, only_paint())->colour(scene.colouring_views(), volume, report);
    BrickGrid grid;
    grid.build(volume);
    Surface surface;
    surface.build(volume, grid);
    ASSERT_EQ(static_cast<int>(volume.colours.size()), surface.size());
    // Seen: some camera looks at the surface not too flatly, and past the other sphere with a margin.
    const auto seen = [&](const float* p, const float* own, const float* other) {
        for (const CameraModel& c : scene.cameras) {
            float to[3], length = 0, facing = 0, along = 0, past = 0;
            for (int axis = 0; axis < 3; ++axis) {
                float centre = 0;
                for (int row = 0; row < 3; ++row)
                    centre -=
                        c.rotation_camera_from_world[3 * row + axis] * c.translation_camera_from_world[row];
                to[axis] = centre - p[axis];
                length += to[axis] * to[axis];
            }
            for (int axis = 0; axis < 3; ++axis) {
                to[axis] /= std::sqrt(length);
                facing += to[axis] * (p[axis] - own[axis]) / 0.2f;
                along += to[axis] * (other[axis] - p[axis]);
                past += (other[axis] - p[axis]) * (other[axis] - p[axis]);
            }
            if (facing > 0.3f && (along < 0 || past - along * along > 0.23f * 0.23f)) return true;
        }
        return false;
    };
    const float red_at[3] = {ax, ay, 1}, green_at[3] = {-ax, -ay, 1};
    std::size_t wrong = 0, checked = 0;
    for (std::size_t n = 0; n < volume.colours.size(); ++n) {
        const float p[3] = {surface.x_m[n], surface.y_m[n], surface.z_m[n]};
        const bool red_side = red(p) < green(p);
        if (!seen(p, red_side ? red_at : green_at, red_side ? green_at : red_at)) continue;
        ++checked;
        const Colour is = volume.colours[n];  // at the rim the black background may be mixed in
        wrong += red_side ? is.g > is.r : is.r > is.g;
    }
    EXPECT_GT(checked, volume.colours.size() / 2);
    EXPECT_LT(wrong, checked / 20);  // the edges between cells
    EXPECT_EQ(report.carved, 0);
    for (float iou : report.silhouette_iou) EXPECT_GT(iou, 0.93f);
}

TEST(Colouring, CarvesPhantomAndKeepsBody) {
    Scene scene = ring_of_cameras(8, 0, 0, 0);
    scene.draw([](const float* p) { return sphere_distance(p, 0, 0, 1, 0.35f); }, checks);
    const auto body = [](const float* p) { return sphere_distance(p, 0, 0, 1, 0.35f) < 0; };
    const auto phantom = [](const float* p) {
        return sphere_distance(p, 0, 0, 1, 0.37f) > 0 && sphere_distance(p, 0.25f, 0.1f, 1.2f, 0.16f) < 0;
    };
    VoxelVolume volume =
        volume_of(make_lattice(0.01f, 96, 96, 96), [&](const float* p) { return body(p) || phantom(p); });
    const std::size_t body_before = count(volume, body), phantom_before = count(volume, phantom);
    ColouringOptions options;
    options.max_rounds = 40;
    options.min_support = 0;  // colours alone
    options.sharp_budget_permille = -1;
    ColouringReport report;
    make_voxel_colourer(Device::kCpu, options)->colour(scene.colouring_views(), volume, report);
    EXPECT_LT(report.rounds, 40) << "did not settle";
    EXPECT_LT(count(volume, phantom), phantom_before / 2);  // patches match by chance occasionally
    EXPECT_GT(count(volume, body), body_before * 99 / 100);
    EXPECT_EQ(report.carved + count(volume, body) + count(volume, [&](const float* p) { return !body(p); }),
              report.carved + count(volume, [](const float*) { return true; }));
}

TEST(Colouring, SharpSilhouettesTrimLooseHull) {
    Scene scene = ring_of_cameras(6, 0, 0, 0);
    scene.draw([](const float* p) { return sphere_distance(p, 0, 0, 1, 0.3f); });
    const auto body = [](const float* p) { return sphere_distance(p, 0, 0, 1, 0.28f) < 0; };
    VoxelVolume volume = volume_of(make_lattice(0.01f, 96, 96, 96),
                                   [](const float* p) { return sphere_distance(p, 0, 0, 1, 0.4f) < 0; });
    const std::size_t before = count(volume, body), all = count(volume, [](const float*) { return true; });
    ColouringOptions options;
    options.min_support = 0;
    options.max_colour_difference_std = 0;
    options.sharp_budget_permille = 0;
    ColouringReport report;
    make_voxel_colourer(Device::kCpu, options)->colour(scene.colouring_views(), volume, report);
    EXPECT_EQ(count(volume, body), before);
    EXPECT_LT(count(volume, [](const float*) { return true; }),
              all * 6 / 10);  // (0.3 / 0.4)^3 and some corners
}

// Four cameras make a prism of a cylinder; a rod thinner than what a ray must keep stays as it is.
TEST(Colouring, RoundsHullButKeepsThinRod) {
    Scene scene = ring_of_cameras(4, 0, 0, 0);
    const auto cylinder = [](const float* p) {
        return std::max(std::hypot(p[0], p[1]) - 0.2f, std::fabs(p[2] - 1) - 0.3f);
    };
    const auto rod = [](const float* p) {
        const float along = std::max({p[2] - 1.5f, 1.25f - p[2], 0.f});
        return std::hypot(p[0] - 0.05f, p[1], along) - 0.025f;
    };
    scene.draw([&](const float* p) { return std::min(cylinder(p), rod(p)); });
    VoxelVolume volume;
    make_hull_carver(Device::kCpu)->carve(scene.hull_views(), make_lattice(0.01f, 80, 80, 128), volume);
    const auto body = [&](const float* p) { return cylinder(p) < 0 && std::fabs(p[2] - 1) < 0.25f; };
    const auto excess = [&](const float* p) { return cylinder(p) > 0.01f && std::fabs(p[2] - 1) < 0.25f; };
    const auto thin = [&](const float* p) { return rod(p) < 0 && p[2] > 1.32f; };
    const std::size_t body_before = count(volume, body), excess_before = count(volume, excess);
    const std::size_t rod_before = count(volume, thin);
    ColouringOptions options;
    options.max_colour_difference_std = 0;
    options.sharp_budget_permille = -1;
    options.max_rounds = 20;
    ColouringReport report;
    make_voxel_colourer(Device::kCpu, options)->colour(scene.colouring_views(), volume, report);
    EXPECT_GT(excess_before, body_before / 20);
    EXPECT_LT(count(volume, excess), excess_before * 3 / 4);
    EXPECT_GT(count(volume, body), body_before * 97 / 100);
    EXPECT_GT(rod_before, 100u);
    EXPECT_GT(count(volume, thin), rod_before * 95 / 100);
    for (float iou : report.silhouette_iou) EXPECT_GT(iou, 0.9f);
}

TEST(Colouring, ResultIsIndependentOfThreads) {
    Scene scene = ring_of_cameras(4, -0.1f, 0.02f, 0);
    scene.draw([](const float* p) { return sphere_distance(p, 0, 0, 1, 0.3f); }, checks);
    const Lattice lattice = make_lattice(0.01f, 80, 80, 80);
    const auto run = [&](VoxelVolume& volume, ColouringReport& report) {
        make_hull_carver(Device::kCpu)->carve(scene.hull_views(), lattice, volume);
        make_voxel_colourer(Device::kCpu)->colour(scene.colouring_views(), volume, report);
    };
    VoxelVolume first;
    ColouringReport first_report;
    run(first, first_report);
    ASSERT_GT(first.bricks.size(), 50u);
    for (int threads : {1, 2, 5}) {
#ifdef KINEVOX_HAVE_TBB
        const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                                threads);
#endif
        VoxelVolume again;
        ColouringReport report;
        run(again, report);
        EXPECT_EQ(bits_of(first), bits_of(again)) << threads;
        EXPECT_EQ(first.colours, again.colours) << threads;
        EXPECT_EQ(first_report.silhouette_iou, report.silhouette_iou) << threads;
        EXPECT_EQ(first_report.carved, report.carved) << threads;
    }
}

TEST(Colouring, HandlesEmptyVolumeAndAbsentImages) {
    Scene scene = ring_of_cameras(3, 0, 0, 0);
    scene.draw([](const float* p) { return sphere_distance(p, 0, 0, 1, 0.3f); }, checks);
    auto colourer = make_voxel_colourer(Device::kCpu);
    VoxelVolume nothing;
    nothing.lattice = make_lattice(0.02f, 32, 32, 32);
    ColouringReport report;
    colourer->colour(scene.colouring_views(), nothing, report);
    EXPECT_TRUE(nothing.colours.empty());
    for (float iou : report.silhouette_iou) EXPECT_EQ(iou, 0.f);  // a silhouette, but no volume

    VoxelVolume volume =
        volume_of(nothing.lattice, [](const float* p) { return sphere_distance(p, 0, 0, 1, 0.2f) < 0; });
    auto views = scene.colouring_views();
    for (ColouringView& view : views) view.image = {}, view.silhouette = view.sharp = nullptr;
    colourer->colour(views, volume, report);
    EXPECT_FALSE(volume.colours.empty());
    for (float iou : report.silhouette_iou) EXPECT_TRUE(std::isnan(iou));
    colourer->colour({}, volume, report);
    EXPECT_FALSE(volume.colours.empty());
}

TEST(Colouring, RejectsInvalidInputByName) {
    using ::testing::HasSubstr;
    using ::testing::ThrowsMessage;
    Scene scene = ring_of_cameras(2, 0, 0, 0);
    scene.draw([](const float* p) { return sphere_distance(p, 0, 0, 1, 0.3f); }, checks);
    VoxelVolume volume = volume_of(make_lattice(0.02f, 16, 16, 16), [](const float*) { return true; });
    ColouringReport report;
    auto views = scene.colouring_views();
    views[1].image.width = 17;
    EXPECT_THAT([&] { make_voxel_colourer(Device::kCpu)->colour(views, volume, report); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("image 1 is 17 x")));
    ColouringOptions options;
    options.min_support = 0.9f;
    EXPECT_THAT(options.check(), HasSubstr("min_support"));
}

TEST(Projection, CoversSourceSilhouetteAndFollowsTranslation) {
    Scene scene = ring_of_cameras(4, -0.1f, 0.02f, 0.0005f);
    const auto ball = [](float x) {
        return [x](const float* p) { return sphere_distance(p, x, 0, 1, 0.3f); };
    };
    scene.draw(ball(0));
    VoxelVolume volume =
        volume_of(make_lattice(0.01f, 72, 72, 72), [&](const float* p) { return ball(0)(p) < 0; });
    Scene moved = scene;
    moved.draw(ball(0.2f));
    for (std::size_t n = 0; n < scene.cameras.size(); ++n) {
        const CameraModel& c = scene.cameras[n];
        for (const bool move : {false, true}) {
            const float translation[3] = {move ? 0.2f : 0.f, 0, 0};
            std::vector<std::uint8_t> mask(static_cast<std::size_t>(c.width) * c.height, 77);
            Rect bounds;
            project_volume(volume, c, translation, 0, mask.data(), bounds);
            const auto& truth = move ? moved.masks[n] : scene.masks[n];
            std::size_t both = 0, either = 0, missing = 0, outside = 0;
            for (int y = 0; y < c.height; ++y)
                for (int x = 0; x < c.width; ++x) {
                    const std::size_t at = static_cast<std::size_t>(y) * c.width + x;
                    ASSERT_TRUE(mask[at] == 0 || mask[at] == 255);
                    both += mask[at] && truth[at];
                    either += mask[at] || truth[at];
                    missing += !mask[at] && truth[at];
                    outside +=
                        mask[at] && (x < bounds.x0 || x >= bounds.x1 || y < bounds.y0 || y >= bounds.y1);
                }
            EXPECT_GT(static_cast<double>(both) / static_cast<double>(either), 0.86);
            EXPECT_LT(missing, either / 100);
            EXPECT_EQ(outside, 0u);
        }
    }
}

}  // namespace
}  // namespace kinevox::kernels
