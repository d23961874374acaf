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

typedef std::uint8_t Bytes __attribute__((vector_size(kBrickEdge)));

// Eight rows of eight voxels, a word each.
KINEVOX_INLINE Rows rows_of(const Brick* brick, int k) {
    Bytes bytes{};
    if (brick) std::memcpy(&bytes, &brick->occupancy[k], sizeof(bytes));
    return __builtin_convertvector(bytes, Rows);
}

KINEVOX_INLINE void collect(const VoxelVolume& volume, const BrickGrid& grid, const Brick& centre,
                            Around& out) {
    for (int dz = 0; dz < 3; ++dz) {
        for (int dy = 0; dy < 3; ++dy) {
            const Brick* bricks[3];
            for (int dx = 0; dx < 3; ++dx) {
                const int found = grid.find(centre.x + dx - 1, centre.y + dy - 1, centre.z + dz - 1);
                bricks[dx] = found < 0 ? nullptr : &volume.bricks[found];
            }
            for (int k = 0; k < kBrickEdge; ++k) {
                const Rows rows =
                    rows_of(bricks[0], k) | rows_of(bricks[1], k) << 8 | rows_of(bricks[2], k) << 16;
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
        lines.add(between<0, 0, 1>(around, k, radius));
        // The four diagonals to come cannot make up for more.
        if (min_lines > 4 && !any_of(lines.at_least(min_lines - 4) & empty)) continue;
        lines.add(between<1, 1, 1>(around, k, diagonal));
        lines.add(between<1, -1, 1>(around, k, diagonal));
        lines.add(between<1, 1, -1>(around, k, diagonal));
        lines.add(between<1, -1, -1>(around, k, diagonal));
        const Bytes slice = __builtin_convertvector((lines.at_least(min_lines) & empty) >> 8, Bytes);
        std::memcpy(&filled[k], &slice, sizeof(slice));
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

}  // namespace

std::int64_t HoleFiller::fill(VoxelVolume& volume, float radius_m, int min_lines) {
    const int bricks = static_cast<int>(volume.bricks.size()),
              radius = fill_radius_voxels(radius_m, volume.lattice.voxel_m);
    if (bricks == 0 || radius < 1) return 0;
    auto find = find_plain;
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) find = find_avx2;
#endif
    grid_.build(volume);
    filled_.resize(static_cast<std::size_t>(bricks) * kBrickEdge);
    parallel_for(0, bricks, kBricksPerTask, [&](int first, int last) {
        for (int n = first; n < last; ++n) {
            find(volume, grid_, n, radius, min_lines,
                 filled_.data() + static_cast<std::size_t>(n) * kBrickEdge);
        }
    });
    std::int64_t count = 0;
    for (std::size_t n = 0; n < filled_.size(); ++n) {
        if (filled_[n] == 0) continue;
        volume.bricks[n / kBrickEdge].occupancy[n % kBrickEdge] |= filled_[n];
        count += std::popcount(filled_[n]);
    }
    return count;
}

}  // namespace kinevox::kernels
