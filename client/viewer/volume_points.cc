#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "client/viewer/shown.h"

namespace kinevox::viewer {
namespace {

constexpr int kNormalRadius = 3;  // voxels
constexpr std::uint8_t kGrey = 196;

// Directions to the neighbours of a voxel. Every second voxel of the ball: half the work, and the normal
// changes by a degree or two.
struct Neighbour {
    int i, j, k;
};

std::vector<Neighbour> neighbours() {
    std::vector<Neighbour> around;
    for (int k = -kNormalRadius; k <= kNormalRadius; ++k)
        for (int j = -kNormalRadius; j <= kNormalRadius; ++j)
            for (int i = -kNormalRadius; i <= kNormalRadius; ++i) {
                const int squared = i * i + j * j + k * k;
                if (squared > 0 && squared <= kNormalRadius * kNormalRadius && (i + j + k) % 2 != 0)
                    around.push_back({i, j, k});
            }
    return around;
}

// The bounding box of the bricks with a rim, one byte per voxel.
struct Box {
    std::array<int, 3> first{}, size{};  // voxels
    std::vector<std::uint8_t> inside;

    explicit Box(const Volume& volume) {
        std::array<int, 3> low{32767, 32767, 32767}, high{0, 0, 0};
        for (const VolumeBrick& b : volume.bricks) {
            const std::array<int, 3> at{b.x, b.y, b.z};
            for (std::size_t d = 0; d < 3; ++d) {
                low[d] = std::min(low[d], at[d]);
                high[d] = std::max(high[d], at[d]);
            }
        }
        for (std::size_t d = 0; d < 3; ++d) {
            first[d] = 8 * low[d] - kNormalRadius;
            size[d] = 8 * (high[d] - low[d] + 1) + 2 * kNormalRadius;
        }
        std::size_t voxels = 1;
        for (const int n : size) voxels *= static_cast<std::size_t>(n);
        inside.assign(voxels, 0);
        for (const VolumeBrick& b : volume.bricks)
            for (int z = 0; z < 8; ++z)
                for (int y = 0; y < 8; ++y) {
                    const auto row = b.occupancy[static_cast<std::size_t>(z)] >> (8 * y) & 0xff;
                    if (row == 0) continue;
                    std::uint8_t* to = inside.data() + at(8 * b.x, 8 * b.y + y, 8 * b.z + z);
                    for (int x = 0; x < 8; ++x) to[x] = row >> x & 1;
                }
    }
    std::ptrdiff_t at(int i, int j, int k) const {
        return (static_cast<std::ptrdiff_t>(k - first[2]) * size[1] + (j - first[1])) * size[0] +
               (i - first[0]);
    }
};

}  // namespace

std::vector<SurfacePoint> surface_points(const Volume& volume) {
    if (volume.bricks.empty()) return {};
    const Box box(volume);
    static const std::vector<Neighbour> kAround = neighbours();
    std::vector<std::ptrdiff_t> steps;
    for (const Neighbour& n : kAround)
        steps.push_back((static_cast<std::ptrdiff_t>(n.k) * box.size[1] + n.j) * box.size[0] + n.i);

    const std::vector<VoxelIndex> voxels = surface_voxels(volume);
    const bool coloured = volume.colours.size() == voxels.size();
    const VolumeGrid& grid = volume.grid;
    std::vector<SurfacePoint> points(voxels.size());
    for (std::size_t n = 0; n < voxels.size(); ++n) {
        const VoxelIndex& v = voxels[n];
        SurfacePoint& point = points[n];
        point.x = static_cast<float>(grid.origin_in_world.x + grid.voxel_m * (v.i + 0.5));
        point.y = static_cast<float>(grid.origin_in_world.y + grid.voxel_m * (v.j + 0.5));
        point.z = static_cast<float>(grid.origin_in_world.z + grid.voxel_m * (v.k + 0.5));
        const Rgb colour = coloured ? volume.colours[n] : Rgb{kGrey, kGrey, kGrey};
        point.r = colour.r, point.g = colour.g, point.b = colour.b;
        const std::uint8_t* centre = box.inside.data() + box.at(v.i, v.j, v.k);
        int x = 0, y = 0, z = 0;
        for (std::size_t s = 0; s < steps.size(); ++s) {
            const int there = centre[steps[s]];
            x -= there * kAround[s].i, y -= there * kAround[s].j, z -= there * kAround[s].k;
        }
        const float length = std::sqrt(static_cast<float>(x * x + y * y + z * z));
        if (length == 0) continue;
        const float scale = 127 / length;
        point.nx = static_cast<std::int8_t>(scale * static_cast<float>(x));
        point.ny = static_cast<std::int8_t>(scale * static_cast<float>(y));
        point.nz = static_cast<std::int8_t>(scale * static_cast<float>(z));
    }
    return points;
}

}  // namespace kinevox::viewer
