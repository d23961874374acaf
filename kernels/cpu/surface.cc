#include "kernels/cpu/surface.h"

#include <bit>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/simd.h"

#ifdef KINEVOX_HAVE_AVX2_FORM
#include <immintrin.h>
#endif

namespace kinevox::kernels {
namespace {

// The surface voxels of one slice of a brick.
struct SurfaceSlice {
    std::uint64_t voxels;
    const std::uint64_t* open;  // for each of the six directions the voxels without a neighbour there
    float x0, y0, z, voxel;     // m: the first voxel's centre, and a voxel's edge
    int k;                      // the slice's number in the brick
};

void list_slice_plain(const SurfaceSlice& slice, Surface& surface, int out) {
    for (std::uint64_t voxels = slice.voxels; voxels; voxels &= voxels - 1, ++out) {
        const int at = std::countr_zero(voxels);
        surface.x_m[out] = slice.x0 + static_cast<float>(at & 7) * slice.voxel;
        surface.y_m[out] = slice.y0 + static_cast<float>(at >> 3) * slice.voxel;
        surface.z_m[out] = slice.z;
        surface.bit[out] = static_cast<std::uint16_t>(slice.k * 64 + at);
        unsigned sides = 0;
        for (int direction = 0; direction < 6; ++direction)
            sides |= static_cast<unsigned>(slice.open[direction] >> at & 1) << direction;
        surface.open[out] = static_cast<std::uint8_t>(sides);
    }
}

#ifdef KINEVOX_HAVE_AVX2_FORM
// Two rows of the slice at a time, those that are surface moved together.
KINEVOX_AVX512 void list_slice_avx512(const SurfaceSlice& slice, Surface& surface, int out) {
    // The form with a mask, for GCC 12 warns of what the other one leaves undefined.
    const auto to_floats = [](__m512i v) KINEVOX_AVX512 { return _mm512_maskz_cvtepi32_ps(0xffff, v); };
    const __m512i lane = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    const __m512 voxel = _mm512_set1_ps(slice.voxel);
    const __m512 x =
        _mm512_add_ps(_mm512_set1_ps(slice.x0),
                      _mm512_mul_ps(to_floats(_mm512_and_si512(lane, _mm512_set1_epi32(7))), voxel));
    for (int first = 0; first < 64; first += 16) {
        const auto here = static_cast<__mmask16>(slice.voxels >> first);
        if (!here) continue;
        const int count = std::popcount(static_cast<unsigned>(here));
        const auto kept = static_cast<__mmask16>((1u << count) - 1);
        const __m512i at = _mm512_add_epi32(lane, _mm512_set1_epi32(first));
        const __m512 y = _mm512_add_ps(_mm512_set1_ps(slice.y0),
                                       _mm512_mul_ps(to_floats(_mm512_srli_epi32(at, 3)), voxel));
        __m512i sides = _mm512_setzero_si512();
        for (int direction = 0; direction < 6; ++direction) {
            const auto open = static_cast<__mmask16>(slice.open[direction] >> first);
            sides = _mm512_mask_or_epi32(sides, open, sides, _mm512_set1_epi32(1 << direction));
        }
        _mm512_mask_storeu_ps(&surface.x_m[out], kept, _mm512_maskz_compress_ps(here, x));
        _mm512_mask_storeu_ps(&surface.y_m[out], kept, _mm512_maskz_compress_ps(here, y));
        _mm512_mask_storeu_ps(&surface.z_m[out], kept, _mm512_set1_ps(slice.z));
        const __m512i bit = _mm512_add_epi32(at, _mm512_set1_epi32(64 * slice.k));
        _mm512_mask_cvtepi32_storeu_epi16(&surface.bit[out], kept, _mm512_maskz_compress_epi32(here, bit));
        _mm512_mask_cvtepi32_storeu_epi8(&surface.open[out], kept, _mm512_maskz_compress_epi32(here, sides));
        out += count;
    }
}
#endif

void list_slice(const SurfaceSlice& slice, Surface& surface, int out) {
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx512()) return list_slice_avx512(slice, surface, out);
#endif
    list_slice_plain(slice, surface, out);
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
    const int bricks = static_cast<int>(volume.bricks.size());
    first.assign(bricks + 1, 0);
    slices_.resize(static_cast<std::size_t>(bricks) * kBrickEdge);
    parallel_for(0, bricks, kBricksPerTask, [&](int begin, int end) {
        for (int n = begin; n < end; ++n) {
            const BrickNeighbours around = grid.neighbours(volume, n);
            int count = 0;
            for (int k = 0; k < kBrickEdge; ++k) {
                const std::uint64_t slice = surface_slice(around, k);
                slices_[static_cast<std::size_t>(n) * kBrickEdge + k] = slice;
                count += std::popcount(slice);
            }
            first[n + 1] = count;
        }
    });
    for (int n = 0; n < bricks; ++n) first[n + 1] += first[n];
    const int count = first[bricks], padded = count + kLanes;
    x_m.resize(padded), y_m.resize(padded), z_m.resize(padded);
    bit.resize(padded), open.resize(padded);
    const Lattice& lattice = volume.lattice;
    const float voxel = lattice.voxel_m;
    parallel_for(0, bricks, kBricksPerTask, [&](int begin, int end) {
        for (int n = begin; n < end; ++n) {
            const Brick& brick = volume.bricks[n];
            const BrickNeighbours around = grid.neighbours(volume, n);
            const auto centre = [&](int axis, int at) {
                return lattice.origin[axis] + (static_cast<float>(at * kBrickEdge) + 0.5f) * voxel;
            };
            const float x0 = centre(0, brick.x), y0 = centre(1, brick.y), z0 = centre(2, brick.z);
            int out = first[n];
            for (int k = 0; k < kBrickEdge; ++k) {
                std::uint64_t slice = slices_[static_cast<std::size_t>(n) * kBrickEdge + k];
                if (!slice) continue;
                std::uint64_t side[6];
                for (int direction = 0; direction < 6; ++direction) {
                    side[direction] = ~neighbour_slice(around, k, direction);
                }
                list_slice({slice, side, x0, y0, z0 + static_cast<float>(k) * voxel, voxel, k}, *this, out);
                out += std::popcount(slice);
            }
        }
    });
}

}  // namespace kinevox::kernels
