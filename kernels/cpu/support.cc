// Counts in bit slices: one word per binary digit holds a digit of the counts of the 64 voxels of a slice, so
// that one addition serves them all; a vector holds four slices, or all eight of a brick.
#include <bit>
#include <stdexcept>
#include <string>
#include <utility>

#include "kernels/cpu/colouring_steps.h"
#include "kernels/cpu/simd.h"
#include "kernels/shared/device.h"

namespace kinevox::kernels {
namespace {

typedef std::uint64_t Four __attribute__((vector_size(32)));
typedef std::uint64_t Eight __attribute__((vector_size(64)));
template <class Words>
constexpr int kWordsOf = static_cast<int>(sizeof(Words) / 8);  // slices at a time

constexpr int digits_of(int max_count) {
    return std::bit_width(static_cast<unsigned>(max_count));
}

// sum += addend; the sum has room for it.
template <class Words, int kSum, int kAddend>
KINEVOX_INLINE void add(Words (&sum)[kSum], const Words (&addend)[kAddend]) {
    Words carry{};
#pragma GCC unroll 12
    for (int n = 0; n < kSum; ++n) {
        const Words a = sum[n];
        if (n < kAddend) {
            const Words either = a ^ addend[n];
            sum[n] = either ^ carry;
            carry = (a & addend[n]) | (either & carry);
        } else {
            sum[n] = a ^ carry;
            carry = a & carry;
        }
    }
}

// Slices of the 3 x 3 columns of bricks around a brick, from `radius` slices below it to `radius` above.
template <class Words, int kRadius>
struct Around {
    static constexpr int kWords = kWordsOf<Words>;
    static constexpr int kSlices = (kBrickEdge + 2 * kRadius + kWords - 1) / kWords * kWords;
    alignas(64) std::uint64_t slice[3][3][kSlices] = {};  // [y][x]
};

template <class Words, int kRadius>
KINEVOX_INLINE void collect(const VoxelVolume& volume, const BrickGrid& grid, int brick,
                            Around<Words, kRadius>& out) {
    const Brick& centre = volume.bricks[brick];
    for (int dz = 0; dz < 3; ++dz) {
        const int from = dz == 0 ? kBrickEdge - kRadius : 0, to = dz == 2 ? kRadius : kBrickEdge;
        const int shift = kRadius + (dz - 1) * kBrickEdge;
        for (int dy = 0; dy < 3; ++dy) {
            for (int dx = 0; dx < 3; ++dx) {
                const int found = grid.find(centre.x + dx - 1, centre.y + dy - 1, centre.z + dz - 1);
                if (found < 0) continue;
                const std::uint64_t* occupancy = volume.bricks[found].occupancy;
                for (int k = from; k < to; ++k) out.slice[dy][dx][k + shift] = occupancy[k];
            }
        }
    }
}

// Column x of every row, in all rows.
constexpr std::uint64_t columns(int first, int last) {
    std::uint64_t mask = 0;
    for (int x = first; x < last; ++x) mask |= kFirstColumn << x;
    return mask;
}

// Sums of 2 * kRadius + 1 neighbours along x.
template <int kRadius, class Words, int kDigits>
KINEVOX_INLINE void sum_along_x(const Words& left, const Words& own, const Words& right,
                                Words (&sum)[kDigits]) {
    for (int n = 0; n < kDigits; ++n) sum[n] = Words{};
    sum[0] = own;
#pragma GCC unroll 8
    for (int s = 1; s <= kRadius; ++s) {
        const Words up[1] = {((own >> s) & columns(0, 8 - s)) | ((right << (8 - s)) & columns(8 - s, 8))};
        const Words down[1] = {((own << s) & columns(s, 8)) | ((left >> (8 - s)) & columns(0, s))};
        add(sum, up);
        add(sum, down);
    }
}

template <class Words, int kRadius>
KINEVOX_INLINE void find_unsupported_body(const VoxelVolume& volume, const BrickGrid& grid, int brick,
                                          int min_count, std::uint64_t* unsupported) {
    constexpr int kEdge = 2 * kRadius + 1;
    constexpr int kX = digits_of(kEdge), kXy = digits_of(kEdge * kEdge),
                  kXyz = digits_of(kEdge * kEdge * kEdge);
    Around<Words, kRadius> around;
    collect(volume, grid, brick, around);
    constexpr int kSlices = Around<Words, kRadius>::kSlices, kWords = kWordsOf<Words>;
    alignas(64) std::uint64_t planes[kXy][kSlices];
    for (int k = 0; k < kSlices; k += kWords) {
        const auto words = [&](int y, int x) __attribute__((always_inline)) {
            Words out;
            std::memcpy(&out, &around.slice[y][x][k], sizeof(out));
            return out;
        };
        Words before[kX], own[kX], after[kX], sum[kXy] = {};
        sum_along_x<kRadius>(words(0, 0), words(0, 1), words(0, 2), before);
        sum_along_x<kRadius>(words(1, 0), words(1, 1), words(1, 2), own);
        sum_along_x<kRadius>(words(2, 0), words(2, 1), words(2, 2), after);
        for (int n = 0; n < kX; ++n) sum[n] = own[n];
#pragma GCC unroll 8
        for (int s = 1; s <= kRadius; ++s) {
            Words up[kX], down[kX];
            for (int n = 0; n < kX; ++n) {
                up[n] = (own[n] >> (8 * s)) | (after[n] << (64 - 8 * s));
                down[n] = (own[n] << (8 * s)) | (before[n] >> (64 - 8 * s));
            }
            add(sum, up);
            add(sum, down);
        }
        for (int n = 0; n < kXy; ++n) std::memcpy(&planes[n][k], &sum[n], sizeof(Words));
    }
    for (int k = 0; k < kBrickEdge; k += kWords) {
        Words sum[kXyz] = {};
#pragma GCC unroll 15
        for (int dz = 0; dz < kEdge; ++dz) {
            Words plane[kXy];
            for (int n = 0; n < kXy; ++n) std::memcpy(&plane[n], &planes[n][k + dz], sizeof(Words));
            add(sum, plane);
        }
        Words less{}, equal = ~Words{};
        for (int n = kXyz - 1; n >= 0; --n) {
            if (min_count >> n & 1) {
                less |= equal & ~sum[n];
                equal &= sum[n];
            } else {
                equal &= ~sum[n];
            }
        }
        if (min_count >> kXyz) less = ~Words{};
        std::memcpy(unsupported + k, &less, sizeof(less));
    }
}

using FindUnsupported = void (*)(const VoxelVolume& volume, const BrickGrid& grid, int brick, int min_count,
                                 std::uint64_t* unsupported);

struct Plain {
    template <int kRadius>
    static void find_unsupported(const VoxelVolume& volume, const BrickGrid& grid, int brick, int min_count,
                                 std::uint64_t* unsupported) {
        find_unsupported_body<Four, kRadius>(volume, grid, brick, min_count, unsupported);
    }
};

#ifdef KINEVOX_HAVE_AVX2_FORM
struct Avx2 {
    template <int kRadius>
    KINEVOX_AVX2 static void find_unsupported(const VoxelVolume& volume, const BrickGrid& grid, int brick,
                                              int min_count, std::uint64_t* unsupported) {
        find_unsupported_body<Four, kRadius>(volume, grid, brick, min_count, unsupported);
    }
};

struct Avx512 {
    template <int kRadius>
    KINEVOX_AVX512 static void find_unsupported(const VoxelVolume& volume, const BrickGrid& grid, int brick,
                                                int min_count, std::uint64_t* unsupported) {
        find_unsupported_body<Eight, kRadius>(volume, grid, brick, min_count, unsupported);
    }
};
#endif

template <class Form, int... kRadii>
FindUnsupported form_of(int radius, std::integer_sequence<int, kRadii...>) {
    constexpr FindUnsupported kForms[] = {Form::template find_unsupported<kRadii + 1>...};
    return kForms[radius - 1];
}

FindUnsupported form_for(int radius) {
    constexpr auto kRadii = std::make_integer_sequence<int, kMaxSupportRadius>{};
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx512()) return form_of<Avx512>(radius, kRadii);
    if (have_avx2()) return form_of<Avx2>(radius, kRadii);
#endif
    return form_of<Plain>(radius, kRadii);
}

}  // namespace

void find_unsupported(const VoxelVolume& volume, const BrickGrid& grid, int brick, int radius, int min_count,
                      std::uint64_t* unsupported) {
    if (radius < 1 || radius > kMaxSupportRadius)
        throw std::invalid_argument("find_unsupported: radius is " + std::to_string(radius) + "; 1 to " +
                                    std::to_string(kMaxSupportRadius) + " is allowed");
    form_for(radius)(volume, grid, brick, min_count, unsupported);
}

}  // namespace kinevox::kernels
