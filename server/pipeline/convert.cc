#include "server/pipeline/convert.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <map>
#include <vector>

namespace kinevox {

Volume to_common(const kernels::VoxelVolume& volume) {
    Volume out;
    // The lattice's float edge and origin are 0.01f and the like; what was meant is a whole number of
    // micrometres.
    const auto exact = [](float metres) { return std::round(1e6 * static_cast<double>(metres)) / 1e6; };
    out.grid.origin_in_world = {exact(volume.lattice.origin[0]), exact(volume.lattice.origin[1]),
                                exact(volume.lattice.origin[2])};
    out.grid.voxel_m = exact(volume.lattice.voxel_m);
    std::copy(std::begin(volume.lattice.size), std::end(volume.lattice.size), out.grid.size.begin());
    out.bricks.reserve(volume.bricks.size());
    for (const kernels::Brick& brick : volume.bricks) {
        VolumeBrick& to = out.bricks.emplace_back(VolumeBrick{brick.x, brick.y, brick.z, {}});
        std::copy(std::begin(brick.occupancy), std::end(brick.occupancy), to.occupancy.begin());
    }
    out.colours.reserve(volume.colours.size());
    for (const kernels::Colour& colour : volume.colours)
        out.colours.push_back({colour.r, colour.g, colour.b});
    return out;
}

void coarsen_by_four(const kernels::VoxelVolume& volume, kernels::VoxelVolume& out) {
    constexpr int kFactor = 4;
    constexpr std::uint64_t kFourByFour = 0x0f0f0f0f;  // x and y below 4
    out.lattice = volume.lattice;
    out.lattice.voxel_m = kFactor * volume.lattice.voxel_m;
    out.colours.clear();
    out.bricks.clear();
    int grid[3];  // coarse bricks
    for (int axis = 0; axis < 3; ++axis) {
        const int bricks = volume.lattice.size[axis] / kernels::kBrickEdge;
        grid[axis] = (bricks + kFactor - 1) / kFactor;
        out.lattice.size[axis] = grid[axis] * kernels::kBrickEdge;
    }
    std::vector<kernels::Brick> dense(static_cast<std::size_t>(grid[0]) * grid[1] * grid[2]);
    for (const kernels::Brick& brick : volume.bricks) {
        const int bx = brick.x / kFactor, by = brick.y / kFactor, bz = brick.z / kFactor;
        kernels::Brick& to = dense[(static_cast<std::size_t>(bz) * grid[1] + by) * grid[0] + bx];
        // A brick becomes 2 x 2 x 2 voxels of the coarse one.
        const int x = 2 * (brick.x % kFactor), y = 2 * (brick.y % kFactor), z = 2 * (brick.z % kFactor);
        for (int half = 0; half < 2; ++half) {
            std::uint64_t layers = 0;
            for (int n = 0; n < 4; ++n) layers |= brick.occupancy[4 * half + n];
            std::uint64_t coarse = 0;
            for (int v = 0; v < 2; ++v)
                for (int u = 0; u < 2; ++u)
                    if (layers >> (32 * v + 4 * u) & kFourByFour)
                        coarse |= std::uint64_t{1} << (8 * (y + v) + x + u);
            to.occupancy[z + half] |= coarse;
        }
    }
    for (int z = 0; z < grid[2]; ++z)
        for (int y = 0; y < grid[1]; ++y)
            for (int x = 0; x < grid[0]; ++x) {
                kernels::Brick& brick = dense[(static_cast<std::size_t>(z) * grid[1] + y) * grid[0] + x];
                const bool any = std::any_of(std::begin(brick.occupancy), std::end(brick.occupancy),
                                             [](std::uint64_t layer) { return layer != 0; });
                if (!any) continue;
                brick.x = static_cast<std::int16_t>(x);
                brick.y = static_cast<std::int16_t>(y);
                brick.z = static_cast<std::int16_t>(z);
                out.bricks.push_back(brick);
            }
}

std::optional<Vec3> centre_of(const kernels::VoxelVolume& volume) {
    std::int64_t count = 0, x = 0, y = 0, z = 0;
    for (const kernels::Brick& brick : volume.bricks) {
        int voxels = 0;
        for (const std::uint64_t layer : brick.occupancy) voxels += std::popcount(layer);
        count += voxels;
        x += std::int64_t{voxels} * brick.x;
        y += std::int64_t{voxels} * brick.y;
        z += std::int64_t{voxels} * brick.z;
    }
    if (count == 0) return std::nullopt;
    const double brick_m = kernels::kBrickEdge * static_cast<double>(volume.lattice.voxel_m);
    const auto middle = [&](int axis, std::int64_t sum) {
        return volume.lattice.origin[axis] +
               brick_m * (static_cast<double>(sum) / static_cast<double>(count) + 0.5);
    };
    return Vec3{middle(0, x), middle(1, y), middle(2, z)};
}

double legs_missing_below(const kernels::VoxelVolume& volume) {
    constexpr double kMinArea_m2 = 0.003;  // of a layer's section; an ankle with its surroundings is larger
    std::map<int, std::int64_t> layers;    // voxels by the bricks' z
    for (const kernels::Brick& brick : volume.bricks) {
        std::int64_t& voxels = layers[brick.z];
        for (const std::uint64_t layer : brick.occupancy) voxels += std::popcount(layer);
    }
    const auto voxel_m = static_cast<double>(volume.lattice.voxel_m);
    const double brick_m = kernels::kBrickEdge * voxel_m;
    std::erase_if(layers, [&](const auto& layer) {
        return static_cast<double>(layer.second) * voxel_m * voxel_m < kMinArea_m2 * kernels::kBrickEdge;
    });
    if (layers.empty()) return 0;
    const auto height_of = [&](int z) { return volume.lattice.origin[2] + brick_m * z; };
    const double middle = height_of(layers.rbegin()->first + 1) / 2;
    // A body whose lowest part is higher lacks all below.
    double missing = std::max(height_of(layers.begin()->first), 0.0);
    for (const auto& [z, voxels] : layers)
        if (height_of(z) <= middle && !layers.contains(z - 1)) missing = std::max(missing, height_of(z));
    return missing;
}

}  // namespace kinevox
