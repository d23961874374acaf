// A coloured voxel volume, and its PLY file; volume_codec.h has its compact form on the wire.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "common/geometry.h"

namespace kinevox {

// An axis-aligned box of cubic voxels in the world frame; voxel (i, j, k) spans origin + edge * [i, i+1) x
// ...
struct VolumeGrid {
    Vec3 origin_in_world;  // m, the corner with the smallest coordinates
    double voxel_m = 0.01;
    std::array<int, 3> size{};  // voxels along x, y, z, each a multiple of 8

    bool operator==(const VolumeGrid&) const = default;
};

// 8 x 8 x 8 voxels; bit (y * 8 + x) of occupancy[z].
struct VolumeBrick {
    std::int16_t x = 0, y = 0, z = 0;  // bricks from the origin
    std::array<std::uint64_t, 8> occupancy{};

    bool operator==(const VolumeBrick&) const = default;
};

struct Rgb {
    std::uint8_t r = 0, g = 0, b = 0;
    bool operator==(const Rgb&) const = default;
};

// Non-empty bricks sorted by (z, y, x). `colours`: one entry per surface voxel (occupied, with one of its six
// neighbours empty) in the order of bricks and of z, y, x inside a brick; or empty.
struct Volume {
    VolumeGrid grid;
    std::vector<VolumeBrick> bricks;
    std::vector<Rgb> colours;

    bool operator==(const Volume&) const = default;
};

// Limit of the codec and its readers: 2^20 bricks are 75 MB, or 537 m3 at 10 mm.
inline constexpr int kMaxBricksPerAxis = 32767;
inline constexpr std::size_t kMaxBricks = 1 << 20;

// Empty if the volume is valid as described above (except colours, which encode_volume() checks), else one
// sentence.
std::string volume_problem(const Volume& volume);

std::int64_t voxel_count(const Volume& volume);
double volume_litres(const Volume& volume);

struct VoxelIndex {
    int i = 0, j = 0, k = 0;
};
// In the order of `colours`.
std::vector<VoxelIndex> surface_voxels(const Volume& volume);

// A volume at 1/2^levels of the resolution: a coarse voxel is occupied if half of its children or more are,
// its colour the mean of its surface children's; each level halves the one before. The grid keeps its origin
// and grows to a multiple of 8 again. levels >= 0.
Volume coarsened(const Volume& volume, int levels);

// A PLY file with the centres of the surface voxels as points: binary little endian, float x y z (m, world)
// and uchar red green blue (grey if the volume has no colours). Atomic.
absl::Status write_volume_ply(const Volume& volume, const std::filesystem::path& file);

// Internal: bit tricks on bricks that volume.cc and the codec share. A slice is one z of a brick: 64 voxels,
// bit (y * 8 + x).
using BrickBits = std::array<std::uint64_t, 8>;

// For each brick the surface voxels: occupied, with one of the six neighbours empty. Bricks sorted, inside
// the grid.
std::vector<BrickBits> surface_bits(const VolumeGrid& grid, std::span<const VolumeBrick> bricks);

namespace volume_bits {

// Exchanges bits `high` and `low` of every bit's index.
template <int high, int low>
constexpr std::uint64_t swap_index_bits(std::uint64_t slice) {
    std::uint64_t mask = 0;  // where index bit `high` is 0 and `low` is 1
    for (int i = 0; i < 64; ++i)
        if (!(i >> high & 1) && (i >> low & 1)) mask |= std::uint64_t{1} << i;
    constexpr int distance = (1 << high) - (1 << low);
    const std::uint64_t changed = ((slice >> distance) ^ slice) & mask;
    return slice ^ changed ^ (changed << distance);
}

// Index bits y2 y1 y0 x2 x1 x0 to y2 x2 y1 x1 y0 x0 and back: then each aligned 2 x 2 block is a nibble, each
// aligned 4 x 4 block 16 bits.
constexpr std::uint64_t morton_from_slice(std::uint64_t slice) {
    return swap_index_bits<2, 1>(swap_index_bits<3, 2>(swap_index_bits<4, 2>(slice)));
}
constexpr std::uint64_t slice_from_morton(std::uint64_t morton) {
    return swap_index_bits<4, 2>(swap_index_bits<3, 2>(swap_index_bits<2, 1>(morton)));
}

}  // namespace volume_bits

}  // namespace kinevox
