#include "tests/support/person_volume.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace kinevox::testing {
namespace {

struct Capsule {
    Vec3 from, to;
    double radius;  // m
    Rgb colour;
};

const Capsule kBody[] = {
    {{0, 0, 1.60}, {0, 0, 1.70}, 0.11, {190, 140, 115}},        // head
    {{0, 0, 1.40}, {0, 0, 1.55}, 0.08, {190, 140, 115}},        // neck
    {{0, -0.10, 1.30}, {0, 0.10, 1.30}, 0.16, {60, 80, 150}},   // shoulders
    {{0, -0.08, 0.95}, {0, 0.08, 1.20}, 0.17, {60, 80, 150}},   // trunk
    {{0, 0.20, 1.38}, {0.1, 0.45, 1.25}, 0.06, {60, 80, 150}},  // upper arms
    {{0, -0.20, 1.38}, {0.1, -0.45, 1.25}, 0.06, {60, 80, 150}},
    {{0.1, 0.45, 1.25}, {0.3, 0.60, 1.40}, 0.045, {190, 140, 115}},
    {{0.1, -0.45, 1.25}, {0.3, -0.60, 1.40}, 0.045, {190, 140, 115}},
    {{0, 0.10, 0.90}, {0.05, 0.14, 0.50}, 0.10, {40, 40, 45}},  // thighs
    {{0, -0.10, 0.90}, {0.10, -0.14, 0.50}, 0.10, {40, 40, 45}},
    {{0.05, 0.14, 0.50}, {0, 0.15, 0.10}, 0.07, {40, 40, 45}},  // shanks
    {{0.10, -0.14, 0.50}, {0, -0.15, 0.10}, 0.07, {40, 40, 45}},
    {{0, 0.15, 0.06}, {0.18, 0.18, 0.06}, 0.055, {220, 220, 215}},
    {{0, -0.15, 0.06}, {0.18, -0.18, 0.06}, 0.055, {220, 220, 215}},
};

double distance_to_segment(Vec3 p, Vec3 a, Vec3 b) {
    const double s = std::clamp(dot(p - a, b - a) / dot(b - a, b - a), 0.0, 1.0);
    return norm(p - a - s * (b - a));
}

// Signed distance to the nearest capsule and which one that is; the skin is dented by some millimetres like a
// hull.
double distance_to_body(Vec3 p, const Capsule*& nearest) {
    double least = 1e9;
    for (const Capsule& capsule : kBody) {
        const double distance = distance_to_segment(p, capsule.from, capsule.to) - capsule.radius;
        if (distance < least) least = distance, nearest = &capsule;
    }
    return least + 0.006 * std::sin(60 * p.x) * std::sin(47 * p.y + 1) * std::sin(53 * p.z);
}

}  // namespace

Vec3 voxel_centre_in_world(const VolumeGrid& grid, VoxelIndex voxel) {
    return grid.origin_in_world + grid.voxel_m * Vec3{voxel.i + 0.5, voxel.j + 0.5, voxel.k + 0.5};
}

Volume volume_of(const VolumeGrid& grid, const std::function<bool(Vec3)>& inside) {
    Volume volume;
    volume.grid = grid;
    for (int bz = 0; bz < grid.size[2] / 8; ++bz)
        for (int by = 0; by < grid.size[1] / 8; ++by)
            for (int bx = 0; bx < grid.size[0] / 8; ++bx) {
                VolumeBrick brick{static_cast<std::int16_t>(bx),
                                  static_cast<std::int16_t>(by),
                                  static_cast<std::int16_t>(bz),
                                  {}};
                for (int z = 0; z < 8; ++z)
                    for (int bit = 0; bit < 64; ++bit)
                        if (inside(voxel_centre_in_world(grid,
                                                         {bx * 8 + bit % 8, by * 8 + bit / 8, bz * 8 + z})))
                            brick.occupancy[z] |= std::uint64_t{1} << bit;
                if (brick.occupancy != VolumeBrick{}.occupancy) volume.bricks.push_back(brick);
            }
    return volume;
}

Volume person_volume(double voxel_m) {
    VolumeGrid grid;
    grid.origin_in_world = {-0.5, -0.8, -0.02};
    grid.voxel_m = voxel_m;
    const double extent_m[3] = {1.0, 1.6, 2.0};
    for (int axis = 0; axis < 3; ++axis)
        grid.size[axis] = static_cast<int>(std::ceil(extent_m[axis] / voxel_m / 8)) * 8;
    const Capsule* nearest = nullptr;
    Volume volume = volume_of(grid, [&](Vec3 p) { return distance_to_body(p, nearest) < 0; });

    std::mt19937 random(7);
    std::normal_distribution<double> noise(0, 3);
    for (const VoxelIndex voxel : surface_voxels(volume)) {
        const Vec3 p = voxel_centre_in_world(grid, voxel);
        distance_to_body(p, nearest);
        // Light from above and one side, a weave with folds, sensor noise.
        const double light =
            0.75 + 0.15 * std::sin(3 * p.y + 1) + 0.1 * p.z + 0.12 * std::sin(40 * p.z + 15 * p.y);
        const auto level = [&](int base) {
            return static_cast<std::uint8_t>(std::clamp(base * light + noise(random), 0.0, 255.0));
        };
        volume.colours.push_back(
            {level(nearest->colour.r), level(nearest->colour.g), level(nearest->colour.b)});
    }
    return volume;
}

}  // namespace kinevox::testing
