#include "kernels/cpu/support.h"

#include <array>
#include <cstring>

namespace kinevox::kernels {
namespace {

// The bits of a byte as eight bytes of 0 or 1, the lowest first.
constexpr std::array<std::uint64_t, 256> make_spread() {
    std::array<std::uint64_t, 256> table{};
    for (int value = 0; value < 256; ++value) {
        for (int bit = 0; bit < 8; ++bit) {
            if (value >> bit & 1) table[value] |= std::uint64_t{1} << (8 * bit);
        }
    }
    return table;
}

constexpr std::array<std::uint64_t, 256> kSpread = make_spread();

// Sums of 2 * radius + 1 neighbours along x for one row: `left`, `own`, `right` are the bytes of three bricks. Eight
// byte-wide sums at a time in one word; at most 15 each.
std::uint64_t sum_row(unsigned left, unsigned own, unsigned right, int radius) {
    const std::uint64_t l = kSpread[left], m = kSpread[own], r = kSpread[right];
    std::uint64_t sum = m;
    for (int shift = 1; shift <= radius; ++shift) {
        const int bits = 8 * shift;
        sum += (m >> bits) | (r << (64 - bits));
        sum += (m << bits) | (l >> (64 - bits));
    }
    return sum;
}

}  // namespace

void count_support(const VoxelVolume& volume, const BrickGrid& grid, int brick, int radius,
                   std::uint16_t* counts) {
    const Brick& centre = volume.bricks[brick];
    constexpr int kMost = kBrickEdge + 2 * kMaxSupportRadius;
    const int size = kBrickEdge + 2 * radius;
    const std::uint64_t* occupancy[3][3][3];
    for (int dz = 0; dz < 3; ++dz) {
        for (int dy = 0; dy < 3; ++dy) {
            for (int dx = 0; dx < 3; ++dx) {
                const int found = grid.find(centre.x + dx - 1, centre.y + dy - 1, centre.z + dz - 1);
                occupancy[dz][dy][dx] = found < 0 ? nullptr : volume.bricks[found].occupancy;
            }
        }
    }
    // Along y per slice: at most 15 * 15 = 225, which still fits a byte.
    std::uint64_t planes[kMost][kBrickEdge];
    for (int z = 0; z < size; ++z) {
        const int gz = z - radius + kBrickEdge, bz = gz >> 3, k = gz & 7;
        std::uint64_t rows[kMost];
        for (int y = 0; y < size; ++y) {
            const int gy = y - radius + kBrickEdge, by = gy >> 3, shift = (gy & 7) * 8;
            const auto byte = [&](int bx) -> unsigned {
                const std::uint64_t* o = occupancy[bz][by][bx];
                return o ? static_cast<unsigned>(o[k] >> shift & 255) : 0u;
            };
            const unsigned left = byte(0), own = byte(1), right = byte(2);
            rows[y] = (left | own | right) ? sum_row(left, own, right, radius) : 0;
        }
        std::uint64_t sum = 0;
        for (int y = 0; y < 2 * radius; ++y) sum += rows[y];
        for (int j = 0; j < kBrickEdge; ++j) {
            sum += rows[j + 2 * radius];
            planes[z][j] = sum;
            sum -= rows[j];
        }
    }
    // Along z in 16 bits: even and odd lanes apart.
    constexpr std::uint64_t kEven = 0x00FF00FF00FF00FFu;
    for (int j = 0; j < kBrickEdge; ++j) {
        std::uint64_t even = 0, odd = 0;
        for (int z = 0; z < 2 * radius; ++z) {
            even += planes[z][j] & kEven;
            odd += planes[z][j] >> 8 & kEven;
        }
        for (int k = 0; k < kBrickEdge; ++k) {
            even += planes[k + 2 * radius][j] & kEven;
            odd += planes[k + 2 * radius][j] >> 8 & kEven;
            std::uint16_t* out = counts + k * 64 + j * 8;
            for (int i = 0; i < 4; ++i) {
                out[2 * i] = static_cast<std::uint16_t>(even >> (16 * i));
                out[2 * i + 1] = static_cast<std::uint16_t>(odd >> (16 * i));
            }
            even -= planes[k][j] & kEven;
            odd -= planes[k][j] >> 8 & kEven;
        }
    }
}

}  // namespace kinevox::kernels
