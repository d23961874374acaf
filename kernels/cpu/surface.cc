#include "kernels/cpu/surface.h"

#include <bit>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/sixteen_lanes.h"

namespace kinevox::kernels {
namespace {

typedef std::uint64_t Slices __attribute__((vector_size(8 * kBrickEdge)));  // of a brick

// The surface voxels of a brick, and for each of the six directions the voxels without a neighbour there.
struct BrickSurface {
    std::uint64_t voxels[kBrickEdge], open[6][kBrickEdge];
};

// surface_slice() and neighbour_slice() of all slices; returns the number of surface voxels.
KINEVOX_INLINE int find_surface(const BrickNeighbours& around, BrickSurface& out) {
    const auto load = [](const std::uint64_t* from) __attribute__((always_inline)) {
        Slices slices{};
        if (from) std::memcpy(&slices, from, sizeof(slices));
        return slices;
    };
    const std::uint64_t *below = around.side[4], *above = around.side[5];
    std::uint64_t column[kBrickEdge + 2];
    column[0] = below ? below[kBrickEdge - 1] : 0;
    std::memcpy(column + 1, around.self, sizeof(Slices));
    column[kBrickEdge + 1] = above ? above[0] : 0;
    const Slices own = load(around.self);
    const Slices neighbour[6] = {
        ((own << 1) & ~kFirstColumn) | ((load(around.side[0]) >> 7) & kFirstColumn),
        ((own >> 1) & ~kLastColumn) | ((load(around.side[1]) << 7) & kLastColumn),
        (own << 8) | (load(around.side[2]) >> 56),
        (own >> 8) | (load(around.side[3]) << 56),
        load(column),
        load(column + 2),
    };
    Slices inner = own;
    for (int direction = 0; direction < 6; ++direction) {
        inner &= neighbour[direction];
        const Slices open = ~neighbour[direction];
        std::memcpy(out.open[direction], &open, sizeof(open));
    }
    const Slices voxels = own & ~inner;
    std::memcpy(out.voxels, &voxels, sizeof(voxels));
    int count = 0;
    for (const std::uint64_t slice : out.voxels) count += __builtin_popcountll(slice);
    return count;
}

// Where a brick's surface voxels are.
struct BrickPlace {
    float x, y, z, voxel;  // m: the first voxel's centre, and a voxel's edge
};

int find_surface_plain(const BrickNeighbours& around, BrickSurface& out) {
    return find_surface(around, out);
}

// Lists the surface voxels from `out` on.
void list_surface_plain(const BrickSurface& brick, const BrickPlace& place, Surface& surface, int out) {
    for (int k = 0; k < kBrickEdge; ++k) {
        const float z = place.z + static_cast<float>(k) * place.voxel;
        for (std::uint64_t voxels = brick.voxels[k]; voxels; voxels &= voxels - 1, ++out) {
            const int at = std::countr_zero(voxels);
            surface.x_m[out] = place.x + static_cast<float>(at & 7) * place.voxel;
            surface.y_m[out] = place.y + static_cast<float>(at >> 3) * place.voxel;
            surface.z_m[out] = z;
            surface.bit[out] = static_cast<std::uint16_t>(k * 64 + at);
            unsigned sides = 0;
            for (int direction = 0; direction < 6; ++direction)
                sides |= static_cast<unsigned>(brick.open[direction][k] >> at & 1) << direction;
            surface.open[out] = static_cast<std::uint8_t>(sides);
        }
    }
}

#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2 int find_surface_avx2(const BrickNeighbours& around, BrickSurface& out) {
    return find_surface(around, out);
}

KINEVOX_AVX512 int find_surface_avx512(const BrickNeighbours& around, BrickSurface& out) {
    return find_surface(around, out);
}

// Two rows of a slice at a time, those that are surface moved together.
KINEVOX_AVX512 void list_surface_avx512(const BrickSurface& brick, const BrickPlace& place, Surface& surface,
                                        int out) {
    // The forms with a mask, for GCC 12 warns of what the others leave undefined.
    const auto to_floats = [](__m512i v) KINEVOX_AVX512 { return _mm512_maskz_cvtepi32_ps(0xffff, v); };
    const __m512i lane = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    const __m512 voxel = sixteen::all(place.voxel);
    const __m512 x = _mm512_add_ps(sixteen::all(place.x),
                                   _mm512_mul_ps(to_floats(_mm512_and_si512(lane, sixteen::all(7))), voxel));
    __m512 ys[4];
    for (int n = 0; n < 4; ++n) {
        const __m512i row = _mm512_srli_epi32(_mm512_add_epi32(lane, sixteen::all(16 * n)), 3);
        ys[n] = _mm512_add_ps(sixteen::all(place.y), _mm512_mul_ps(to_floats(row), voxel));
    }
    for (int k = 0; k < kBrickEdge; ++k) {
        const __m512 z = sixteen::all(place.z + static_cast<float>(k) * place.voxel);
        for (int n = 0; n < 4; ++n) {
            const auto here = static_cast<__mmask16>(brick.voxels[k] >> (16 * n));
            if (!here) continue;
            const int count = std::popcount(static_cast<unsigned>(here));
            const auto kept = static_cast<__mmask16>((1u << count) - 1);
            __m512i sides = _mm512_setzero_si512();
            for (int direction = 0; direction < 6; ++direction) {
                const auto open = static_cast<__mmask16>(brick.open[direction][k] >> (16 * n));
                sides = _mm512_mask_or_epi32(sides, open, sides, sixteen::all(1 << direction));
            }
            _mm512_mask_storeu_ps(&surface.x_m[out], kept, _mm512_maskz_compress_ps(here, x));
            _mm512_mask_storeu_ps(&surface.y_m[out], kept, _mm512_maskz_compress_ps(here, ys[n]));
            _mm512_mask_storeu_ps(&surface.z_m[out], kept, z);
            const __m512i bit = _mm512_add_epi32(lane, sixteen::all(64 * k + 16 * n));
            _mm256_mask_storeu_epi16(
                &surface.bit[out], kept,
                _mm512_maskz_cvtepi32_epi16(kept, _mm512_maskz_compress_epi32(here, bit)));
            _mm_mask_storeu_epi8(&surface.open[out], kept,
                                 _mm512_maskz_cvtepi32_epi8(kept, _mm512_maskz_compress_epi32(here, sides)));
            out += count;
        }
    }
}
#endif

struct Form {
    int (*find)(const BrickNeighbours& around, BrickSurface& out);
    void (*list)(const BrickSurface& brick, const BrickPlace& place, Surface& surface, int out);
};

Form best_form() {
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx512()) return {find_surface_avx512, list_surface_avx512};
    if (have_avx2()) return {find_surface_avx2, list_surface_plain};
#endif
    return {find_surface_plain, list_surface_plain};
}

}  // namespace

void BrickGrid::build(const VoxelVolume& volume) {
    nx_ = volume.lattice.size[0] / kBrickEdge + 2;
    ny_ = volume.lattice.size[1] / kBrickEdge + 2;
    const int nz = volume.lattice.size[2] / kBrickEdge + 2;
    index_.assign(static_cast<std::size_t>(nx_) * ny_ * nz, -1);
    for (std::size_t n = 0; n < volume.bricks.size(); ++n) {
        const Brick& b = volume.bricks[n];
        index_[(static_cast<std::size_t>(b.z + 1) * ny_ + (b.y + 1)) * nx_ + (b.x + 1)] = static_cast<int>(n);
    }
}

BrickNeighbours BrickGrid::neighbours(const VoxelVolume& volume, int brick) const {
    const Brick& b = volume.bricks[brick];
    BrickNeighbours out;
    out.self = b.occupancy;
    const auto at = [&](int dx, int dy, int dz) -> const std::uint64_t* {
        const int found = find(b.x + dx, b.y + dy, b.z + dz);
        return found < 0 ? nullptr : volume.bricks[found].occupancy;
    };
    out.side[0] = at(-1, 0, 0), out.side[1] = at(1, 0, 0);
    out.side[2] = at(0, -1, 0), out.side[3] = at(0, 1, 0);
    out.side[4] = at(0, 0, -1), out.side[5] = at(0, 0, 1);
    return out;
}

void Surface::build(const VoxelVolume& volume, const BrickGrid& grid) {
    constexpr int kBricksPerTask = 32;
    const Form form = best_form();
    const int bricks = static_cast<int>(volume.bricks.size());
    first.assign(bricks + 1, 0);
    parallel_for(0, bricks, kBricksPerTask, [&](int begin, int end) {
        BrickSurface found;
        for (int n = begin; n < end; ++n) first[n + 1] = form.find(grid.neighbours(volume, n), found);
    });
    for (int n = 0; n < bricks; ++n) first[n + 1] += first[n];
    const int count = first[bricks], padded = count + kLanes;
    x_m.resize(padded), y_m.resize(padded), z_m.resize(padded);
    bit.resize(padded), open.resize(padded);
    const Lattice& lattice = volume.lattice;
    const float voxel = lattice.voxel_m;
    parallel_for(0, bricks, kBricksPerTask, [&](int begin, int end) {
        BrickSurface found;
        for (int n = begin; n < end; ++n) {
            if (first[n] == first[n + 1]) continue;
            const Brick& brick = volume.bricks[n];
            const auto centre = [&](int axis, int at) {
                return lattice.origin[axis] + (static_cast<float>(at * kBrickEdge) + 0.5f) * voxel;
            };
            form.find(grid.neighbours(volume, n), found);
            form.list(found, {centre(0, brick.x), centre(1, brick.y), centre(2, brick.z), voxel}, *this,
                      first[n]);
        }
    });
}

}  // namespace kinevox::kernels
