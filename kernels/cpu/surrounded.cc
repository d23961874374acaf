#include "kernels/cpu/surrounded.h"

#include <bit>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/simd.h"
#include "kernels/shared/device.h"

namespace kinevox::kernels {
namespace {

constexpr int kEdge = 3 * kBrickEdge;
constexpr int kBricksPerTask = 8;
typedef std::uint32_t Rows __attribute__((vector_size(4 * kBrickEdge)));  // rows y .. y + 7 along x

// A brick and the 26 around it, a word a row: bit x of row (z, y), the brick's own voxels from 8 to 15 each
// way.
struct Around {
    std::uint32_t row[kEdge][kEdge];
};

typedef std::uint64_t Pairs __attribute__((vector_size(4 * kBrickEdge)));
constexpr Pairs kPairShift = {0, 16, 32, 48};

// The eight rows of a slice, a word each, from pairs of rows: GCC 12 would convert byte by byte.
KINEVOX_INLINE Rows rows_of(std::uint64_t slice) {
    const Pairs pairs = (Pairs{} + slice) >> kPairShift;
    return reinterpret_cast<Rows>((pairs & 0xff) | (pairs & 0xff00) << 24);
}

KINEVOX_INLINE std::uint64_t slice_of(const Rows& rows) {
    Pairs pairs = reinterpret_cast<Pairs>(rows);
    pairs = ((pairs & 0xff) | (pairs >> 24 & 0xff00)) << kPairShift;
    return pairs[0] | pairs[1] | pairs[2] | pairs[3];
}

KINEVOX_INLINE void collect(const VoxelVolume& volume, const BrickGrid& grid, const Brick& centre,
                            Around& out) {
    for (int dz = 0; dz < 3; ++dz) {
        for (int dy = 0; dy < 3; ++dy) {
            static constexpr std::uint64_t kNothing[kBrickEdge] = {};
            const std::uint64_t* slices[3];
            for (int dx = 0; dx < 3; ++dx) {
                const int found = grid.find(centre.x + dx - 1, centre.y + dy - 1, centre.z + dz - 1);
                slices[dx] = found < 0 ? kNothing : volume.bricks[found].occupancy;
            }
            for (int k = 0; k < kBrickEdge; ++k) {
                const Rows rows =
                    rows_of(slices[0][k]) | rows_of(slices[1][k]) << 8 | rows_of(slices[2][k]) << 16;
                std::memcpy(&out.row[dz * kBrickEdge + k][dy * kBrickEdge], &rows, sizeof(rows));
            }
        }
    }
}

// Where a voxel of slice k has one within `steps` steps of (kX, kY, kZ) on both sides.
template <int kX, int kY, int kZ>
KINEVOX_INLINE Rows between(const Around& around, int k, int steps) {
    Rows after{}, before{};
    for (int s = 1; s <= steps; ++s) {
        Rows up, down;
        std::memcpy(&up, &around.row[kBrickEdge + k + s * kZ][kBrickEdge + s * kY], sizeof(up));
        std::memcpy(&down, &around.row[kBrickEdge + k - s * kZ][kBrickEdge - s * kY], sizeof(down));
        static_assert(kX == 0 || kX == 1);
        after |= kX ? up >> s : up;
        before |= kX ? down << s : down;
    }
    return after & before;
}

// How many lines, a word a binary digit.
struct LineCount {
    Rows ones{}, twos{}, fours{};

    KINEVOX_INLINE void add(const Rows& line) {
        const Rows to_twos = ones & line;
        ones ^= line;
        fours |= twos & to_twos;
        twos ^= to_twos;
    }
    KINEVOX_INLINE Rows at_least(int least) const {
        Rows enough{};
        for (int count = least; count <= kFillLines; ++count) {
            enough |= (count & 1 ? ones : ~ones) & (count & 2 ? twos : ~twos) & (count & 4 ? fours : ~fours);
        }
        return enough;
    }
};

KINEVOX_INLINE bool any_of(const Rows& rows) {
    std::uint64_t words[4];
    std::memcpy(words, &rows, sizeof(words));
    return (words[0] | words[1] | words[2] | words[3]) != 0;
}

// The lines are those of fill_line().
KINEVOX_INLINE void find_body(const VoxelVolume& volume, const BrickGrid& grid, int brick, int radius,
                              int min_lines, std::uint64_t* filled) {
    static_assert(kFillLines == 7);
    const Brick& centre = volume.bricks[brick];
    Around around;
    collect(volume, grid, centre, around);
    const int diagonal = fill_steps(3, radius);
    for (int k = 0; k < kBrickEdge; ++k) {
        filled[k] = 0;
        Rows own;
        std::memcpy(&own, &around.row[kBrickEdge + k][kBrickEdge], sizeof(own));
        const Rows empty = ~own & 0xff00u;
        if (!any_of(empty)) continue;
        LineCount lines;
        lines.add(between<1, 0, 0>(around, k, radius));
        lines.add(between<0, 1, 0>(around, k, radius));
        if (min_lines > 5 && !any_of((lines.ones | lines.twos) & empty))
            continue;  // five more cannot make up
        lines.add(between<0, 0, 1>(around, k, radius));
        // The four diagonals to come cannot make up for more.
        if (min_lines > 4 && !any_of(lines.at_least(min_lines - 4) & empty)) continue;
        lines.add(between<1, 1, 1>(around, k, diagonal));
        lines.add(between<1, -1, 1>(around, k, diagonal));
        lines.add(between<1, 1, -1>(around, k, diagonal));
        lines.add(between<1, -1, -1>(around, k, diagonal));
        filled[k] = slice_of((lines.at_least(min_lines) & empty) >> 8);
    }
}

void find_plain(const VoxelVolume& volume, const BrickGrid& grid, int brick, int radius, int min_lines,
                std::uint64_t* filled) {
    find_body(volume, grid, brick, radius, min_lines, filled);
}

#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2 void find_avx2(const VoxelVolume& volume, const BrickGrid& grid, int brick, int radius,
                            int min_lines, std::uint64_t* filled) {
    find_body(volume, grid, brick, radius, min_lines, filled);
}
#endif

bool is_full(const Brick& brick) {
    std::uint64_t all = ~std::uint64_t{0};
    for (const std::uint64_t slice : brick.occupancy) all &= slice;
    return ~all == 0;
}

}  // namespace

std::int64_t HoleFiller::fill(VoxelVolume& volume, float radius_m, int min_lines, int passes) {
    const int bricks = static_cast<int>(volume.bricks.size()),
              radius = fill_radius_voxels(radius_m, volume.lattice.voxel_m);
    if (bricks == 0 || radius < 1) return 0;
    auto find = find_plain;
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) find = find_avx2;
#endif
    grid_.build(volume);
    has_filled_.assign(bricks, 0);
    std::int64_t count = 0;
    for (int pass = 0; pass < passes; ++pass) {
        filled_.assign(static_cast<std::size_t>(bricks) * kBrickEdge, 0);
        parallel_for(0, bricks, kBricksPerTask, [&](int first, int last) {
            for (int n = first; n < last; ++n) {
                const Brick& brick = volume.bricks[n];
                // Where the last pass filled nothing near, this one finds the same: nothing.
                if (is_full(brick) || (pass > 0 && !filled_around(brick))) continue;
                find(volume, grid_, n, radius, min_lines,
                     filled_.data() + static_cast<std::size_t>(n) * kBrickEdge);
            }
        });
        const std::int64_t added = add_filled(volume);
        count += added;
        if (added == 0) break;
    }
    return count;
}

std::int64_t HoleFiller::add_filled(VoxelVolume& volume) {
    std::int64_t count = 0;
    for (std::size_t n = 0; n < volume.bricks.size(); ++n) {
        has_filled_[n] = 0;
        for (int k = 0; k < kBrickEdge; ++k) {
            const std::uint64_t filled = filled_[n * kBrickEdge + k];
            if (filled == 0) continue;
            volume.bricks[n].occupancy[k] |= filled;
            count += std::popcount(filled);
            has_filled_[n] = 1;
        }
    }
    return count;
}

bool HoleFiller::filled_around(const Brick& brick) const {
    for (int dz = -1; dz <= 1; ++dz)
        for (int dy = -1; dy <= 1; ++dy)
            for (int dx = -1; dx <= 1; ++dx) {
                const int near = grid_.find(brick.x + dx, brick.y + dy, brick.z + dz);
                if (near >= 0 && has_filled_[near]) return true;
            }
    return false;
}

}  // namespace kinevox::kernels
