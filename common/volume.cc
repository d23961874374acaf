#include "common/volume.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "common/files.h"

namespace kinevox {
namespace {

constexpr std::uint64_t kFirstColumn = 0x0101010101010101;  // x == 0
constexpr std::uint64_t kLastColumn = kFirstColumn << 7;    // x == 7

// Bricks in one line: rising with the order (z, y, x). Stays below 2^45 for indices below 2^15.
struct BrickOrder {
    explicit BrickOrder(const VolumeGrid& grid) : nx(grid.size[0] / 8), ny(grid.size[1] / 8) {}
    std::int64_t nx, ny;
    std::int64_t operator()(const VolumeBrick& b) const { return (b.z * ny + b.y) * nx + b.x; }
};

// Finds the neighbours at one offset for bricks asked in rising order, in one walk along the list.
class NeighbourCursor {
  public:
    NeighbourCursor(std::span<const VolumeBrick> bricks, BrickOrder order, std::int64_t offset)
        : bricks_(bricks), order_(order), offset_(offset) {}
    // `inside`: false where the neighbour would lie outside the grid.
    const std::uint64_t* find(const VolumeBrick& brick, bool inside) {
        static constexpr BrickBits kNothing{};
        const std::int64_t wanted = order_(brick) + offset_;
        while (next_ < bricks_.size() && order_(bricks_[next_]) < wanted) ++next_;
        const bool found = inside && next_ < bricks_.size() && order_(bricks_[next_]) == wanted;
        return found ? bricks_[next_].occupancy.data() : kNothing.data();
    }

  private:
    std::span<const VolumeBrick> bricks_;
    BrickOrder order_;
    std::int64_t offset_;
    std::size_t next_ = 0;
};

template <typename Visit>  // visit(voxel index within the brick's slice z)
void for_each_bit(const BrickBits& bits, Visit visit) {
    for (int z = 0; z < 8; ++z)
        for (std::uint64_t left = bits[z]; left != 0; left &= left - 1) visit(z, std::countr_zero(left));
}

int halved_size(int size) {
    return (size / 2 + 7) / 8 * 8;
}

// Sums of the children's colours of one coarse brick.
struct ColourSums {
    struct Sum {
        std::uint16_t r = 0, g = 0, b = 0, count = 0;
    };
    std::array<Sum, 512> voxels{};
};

// The 4 x 4 x 4 coarse voxels that a brick becomes, as an octant of its coarse brick.
void halve_brick(const VolumeBrick& fine, VolumeBrick& coarse) {
    const int shift_x = (fine.x & 1) * 4, shift_y = (fine.y & 1) * 4, shift_z = (fine.z & 1) * 4;
    for (int z = 0; z < 4; ++z) {
        const std::uint64_t low = volume_bits::morton_from_slice(fine.occupancy[2 * z]);
        const std::uint64_t high = volume_bits::morton_from_slice(fine.occupancy[2 * z + 1]);
        std::uint64_t quarter = 0;  // bit (y * 8 + x), x and y below 4
        for (int cell = 0; cell < 16; ++cell) {
            const auto children =
                static_cast<unsigned>((low >> 4 * cell & 15) | (high >> 4 * cell & 15) << 4);
            const int x = (cell & 1) | (cell >> 1 & 2), y = (cell >> 1 & 1) | (cell >> 2 & 2);
            if (std::popcount(children) >= 4) quarter |= std::uint64_t{1} << (y * 8 + x);
        }
        coarse.occupancy[shift_z + z] |= quarter << (shift_y * 8 + shift_x);
    }
}

Volume halved(const Volume& volume) {
    Volume out;
    out.grid = volume.grid;
    out.grid.voxel_m *= 2;
    for (int& size : out.grid.size) size = halved_size(size);
    const BrickOrder order(out.grid);
    const auto parent_of = [](const VolumeBrick& fine) {
        VolumeBrick parent;
        parent.x = fine.x / 2, parent.y = fine.y / 2, parent.z = fine.z / 2;
        return parent;
    };
    const auto before = [&](const VolumeBrick& a, const VolumeBrick& b) { return order(a) < order(b); };

    std::vector<VolumeBrick> parents;
    for (const VolumeBrick& fine : volume.bricks)
        if (parents.empty() || order(parents.back()) != order(parent_of(fine)))
            parents.push_back(parent_of(fine));
    std::sort(parents.begin(), parents.end(), before);
    parents.erase(std::unique(parents.begin(), parents.end()), parents.end());

    const bool coloured = !volume.colours.empty();
    std::vector<ColourSums> sums(coloured ? parents.size() : 0);
    const std::vector<BrickBits> surface =
        coloured ? surface_bits(volume.grid, volume.bricks) : std::vector<BrickBits>{};
    const Rgb* colour = volume.colours.data();
    for (std::size_t i = 0; i < volume.bricks.size(); ++i) {
        const VolumeBrick& fine = volume.bricks[i];
        const std::size_t parent =
            std::lower_bound(parents.begin(), parents.end(), parent_of(fine), before) - parents.begin();
        halve_brick(fine, parents[parent]);
        if (!coloured) continue;
        for_each_bit(surface[i], [&](int z, int bit) {
            const int x = (fine.x & 1) * 4 + (bit & 7) / 2, y = (fine.y & 1) * 4 + bit / 16;
            ColourSums::Sum& sum = sums[parent].voxels[((fine.z & 1) * 4 + z / 2) * 64 + y * 8 + x];
            sum.r += colour->r, sum.g += colour->g, sum.b += colour->b, ++sum.count;
            ++colour;
        });
    }

    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < parents.size(); ++i) {
        if (parents[i].occupancy == BrickBits{}) continue;
        out.bricks.push_back(parents[i]);
        kept.push_back(i);
    }
    if (!coloured) return out;
    // A coarse surface voxel always has a coloured child: either it has an occupied child beside an empty
    // one, or all eight are occupied and one of them touches a neighbour that is less than half full on that
    // side.
    const std::vector<BrickBits> coarse_surface = surface_bits(out.grid, out.bricks);
    for (std::size_t i = 0; i < out.bricks.size(); ++i)
        for_each_bit(coarse_surface[i], [&](int z, int bit) {
            const ColourSums::Sum sum = sums[kept[i]].voxels[z * 64 + bit];
            const int n = std::max<int>(sum.count, 1);
            const auto mean = [n](int total) { return static_cast<std::uint8_t>((total + n / 2) / n); };
            out.colours.push_back({mean(sum.r), mean(sum.g), mean(sum.b)});
        });
    return out;
}

static_assert(std::endian::native == std::endian::little, "points are written as they lie in memory");

constexpr Rgb kGrey{180, 180, 180};
constexpr std::size_t kPointBytes = 3 * sizeof(float) + 3;

}  // namespace

std::vector<BrickBits> surface_bits(const VolumeGrid& grid, std::span<const VolumeBrick> bricks) {
    const BrickOrder order(grid);
    const int nx = grid.size[0] / 8, ny = grid.size[1] / 8, nz = grid.size[2] / 8;
    NeighbourCursor x_low(bricks, order, -1), x_high(bricks, order, 1);
    NeighbourCursor y_low(bricks, order, -order.nx), y_high(bricks, order, order.nx);
    NeighbourCursor z_low(bricks, order, -order.nx * order.ny), z_high(bricks, order, order.nx * order.ny);
    std::vector<BrickBits> surface(bricks.size());
    for (std::size_t i = 0; i < bricks.size(); ++i) {
        const VolumeBrick& brick = bricks[i];
        const auto& own = brick.occupancy;
        const std::uint64_t* left = x_low.find(brick, brick.x > 0);
        const std::uint64_t* right = x_high.find(brick, brick.x + 1 < nx);
        const std::uint64_t* front = y_low.find(brick, brick.y > 0);
        const std::uint64_t* back = y_high.find(brick, brick.y + 1 < ny);
        const std::uint64_t below = z_low.find(brick, brick.z > 0)[7];
        const std::uint64_t above = z_high.find(brick, brick.z + 1 < nz)[0];
        for (int z = 0; z < 8; ++z) {
            const std::uint64_t s = own[z];
            const std::uint64_t neighbours = ((s << 1 & ~kFirstColumn) | (left[z] >> 7 & kFirstColumn)) &
                                             ((s >> 1 & ~kLastColumn) | (right[z] << 7 & kLastColumn)) &
                                             (s << 8 | front[z] >> 56) & (s >> 8 | back[z] << 56) &
                                             (z > 0 ? own[z - 1] : below) & (z < 7 ? own[z + 1] : above);
            surface[i][z] = s & ~neighbours;
        }
    }
    return surface;
}

std::int64_t voxel_count(const Volume& volume) {
    std::int64_t count = 0;
    for (const VolumeBrick& brick : volume.bricks)
        for (const std::uint64_t slice : brick.occupancy) count += std::popcount(slice);
    return count;
}

double volume_litres(const Volume& volume) {
    const double edge_dm = volume.grid.voxel_m * 10;
    return static_cast<double>(voxel_count(volume)) * edge_dm * edge_dm * edge_dm;
}

std::vector<VoxelIndex> surface_voxels(const Volume& volume) {
    std::vector<VoxelIndex> out;
    out.reserve(volume.colours.size());
    const std::vector<BrickBits> surface = surface_bits(volume.grid, volume.bricks);
    for (std::size_t i = 0; i < volume.bricks.size(); ++i) {
        const VolumeBrick& brick = volume.bricks[i];
        for_each_bit(surface[i], [&](int z, int bit) {
            out.push_back({brick.x * 8 + (bit & 7), brick.y * 8 + bit / 8, brick.z * 8 + z});
        });
    }
    return out;
}

std::string volume_problem(const Volume& volume) {
    const VolumeGrid& grid = volume.grid;
    for (const int size : grid.size)
        if (size < 0 || size % 8 != 0 || size / 8 > kMaxBricksPerAxis)
            return fmt::format("the grid is {} voxels long, expected a multiple of 8 up to {}", size,
                               8 * kMaxBricksPerAxis);
    if (!std::isfinite(grid.voxel_m) || !(grid.voxel_m > 0))
        return fmt::format("the voxel edge is {} m", grid.voxel_m);
    const Vec3 origin = grid.origin_in_world;
    if (!std::isfinite(origin.x) || !std::isfinite(origin.y) || !std::isfinite(origin.z))
        return "the grid's origin is not finite";
    if (volume.bricks.size() > kMaxBricks)
        return fmt::format("there are {} bricks, at most {} can be handled; use larger voxels",
                           volume.bricks.size(), kMaxBricks);
    const BrickOrder order(grid);
    std::int64_t previous = -1;
    for (const VolumeBrick& b : volume.bricks) {
        if (b.x < 0 || b.y < 0 || b.z < 0 || b.x >= grid.size[0] / 8 || b.y >= grid.size[1] / 8 ||
            b.z >= grid.size[2] / 8)
            return fmt::format("brick ({}, {}, {}) lies outside the grid", b.x, b.y, b.z);
        if (order(b) <= previous) return fmt::format("brick ({}, {}, {}) is out of order", b.x, b.y, b.z);
        if (b.occupancy == BrickBits{}) return fmt::format("brick ({}, {}, {}) is empty", b.x, b.y, b.z);
        previous = order(b);
    }
    return "";
}

Volume coarsened(const Volume& volume, int levels) {
    Volume out = volume;
    for (int level = 0; level < levels; ++level) out = halved(out);
    return out;
}

absl::Status write_volume_ply(const Volume& volume, const std::filesystem::path& file) {
    const std::vector<VoxelIndex> surface = surface_voxels(volume);
    const bool coloured = !volume.colours.empty();
    if (coloured && volume.colours.size() != surface.size())
        return absl::InvalidArgumentError(
            fmt::format("{}: not written: the volume has {} colours for {} surface voxels", file.string(),
                        volume.colours.size(), surface.size()));
    std::string out = fmt::format(
        "ply\nformat binary_little_endian 1.0\ncomment surface voxel centres, edge {} m\nelement vertex {}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        volume.grid.voxel_m, surface.size());
    std::size_t at = out.size();
    out.resize(at + surface.size() * kPointBytes);
    for (std::size_t i = 0; i < surface.size(); ++i, at += kPointBytes) {
        const VoxelIndex v = surface[i];
        const Vec3 centre =
            volume.grid.origin_in_world + volume.grid.voxel_m * Vec3{v.i + 0.5, v.j + 0.5, v.k + 0.5};
        const float position[3] = {static_cast<float>(centre.x), static_cast<float>(centre.y),
                                   static_cast<float>(centre.z)};
        const Rgb colour = coloured ? volume.colours[i] : kGrey;
        const std::uint8_t channels[3] = {colour.r, colour.g, colour.b};
        std::memcpy(out.data() + at, position, sizeof position);
        std::memcpy(out.data() + at + sizeof position, channels, sizeof channels);
    }
    return write_file_atomically(file, out);
}

}  // namespace kinevox
