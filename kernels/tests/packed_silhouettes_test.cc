#include "kernels/cpu/packed_silhouettes.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace kinevox::kernels::cpu {
namespace {

// The same, pixel by pixel.
std::vector<std::uint8_t> mask_of(const PackedSilhouettes& packed, const unsigned long long* words) {
    std::vector<std::uint8_t> mask(static_cast<std::size_t>(packed.width) * packed.height, 0);
    const int columns = (packed.searched.width() + 63) / 64;
    for (int y = packed.found.y0; y < packed.found.y1; ++y)
        for (int x = packed.found.x0; x < packed.found.x1; ++x) {
            const int column = x - packed.searched.x0;
            const unsigned long long word = words[(y - packed.searched.y0) * columns + column / 64];
            if (word >> column % 64 & 1) mask[static_cast<std::size_t>(y) * packed.width + x] = 255;
        }
    return mask;
}

TEST(PackedSilhouettes, UnpackIntoUsedMemoryLeavesNothingOfTheLastFrame) {
    constexpr int kWidth = 150, kHeight = 40;
    std::mt19937_64 random(3);
    Silhouettes out;
    // Searched and found; the image's last cell is not whole.
    const Rect frames[][2] = {{{0, 0, 150, 40}, {64, 5, 150, 30}},
                              {{64, 10, 128, 30}, {64, 12, 128, 13}},
                              {{0, 0, 150, 40}, {150, 40, 0, 0}},
                              {{0, 3, 64, 20}, {0, 3, 64, 20}}};
    for (const auto& [searched, found] : frames) {
        const std::size_t cells = static_cast<std::size_t>((searched.width() + 63) / 64) * searched.height();
        std::vector<unsigned long long> sharp(cells), loose(cells);
        std::vector<std::uint8_t> probability(64 * cells, 0);
        const PackedSilhouettes packed{kWidth,       kHeight,      searched,          found,
                                       sharp.data(), loose.data(), probability.data()};
        const int columns = (searched.width() + 63) / 64;
        for (int y = searched.y0; y < searched.y1; ++y)
            for (int n = 0; n < columns; ++n) {
                const std::size_t cell = static_cast<std::size_t>(y - searched.y0) * columns + n;
                const int left = kWidth - searched.x0 - 64 * n;
                const unsigned long long valid = left < 64 ? (1ull << left) - 1 : ~0ull;
                loose[cell] = (y % 3 == 0 ? ~0ull : y % 3 == 1 ? random() : 0) & valid;
                sharp[cell] = loose[cell] & random();
                for (int i = 0; i < 64; ++i)
                    probability[64 * cell + i] = static_cast<std::uint8_t>(loose[cell] >> i & 1 ? 200 : 0);
            }
        unpack(packed, out);
        out.bounds = found.empty() ? Rect{} : found;
        const std::vector<std::uint8_t> expected = mask_of(packed, loose.data());
        EXPECT_EQ(out.loose, expected);
        EXPECT_EQ(out.sharp, mask_of(packed, sharp.data()));
        for (std::size_t n = 0; n < expected.size(); ++n)
            ASSERT_EQ(out.probability[n], expected[n] ? 200 : 0) << "pixel " << n;
        EXPECT_EQ(out.searched, searched);
    }
}

}  // namespace
}  // namespace kinevox::kernels::cpu
