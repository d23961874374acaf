#include "kernels/cpu/chessboard_distance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <random>

namespace kinevox::kernels {
namespace {

// By looking at every other cell. What lies around has bit 1.
int distance_to(const std::vector<std::uint8_t>& kind, int width, int height, int x, int y, int bit) {
    int nearest = bit == 2 ? std::min({x + 1, y + 1, width - x, height - y}) : 127;
    for (int v = 0; v < height; ++v)
        for (int u = 0; u < width; ++u)
            if (kind[v * width + u] & bit)
                nearest = std::min(nearest, std::max(std::abs(u - x), std::abs(v - y)));
    return std::min(nearest, 127);
}

TEST(ChessboardDistance, EqualsMinimumOverAllCells) {
    std::mt19937 random(9);
    std::vector<std::uint8_t> scratch;
    for (const auto& [width, height] : {std::pair{1, 1}, {16, 3}, {17, 20}, {33, 40}, {150, 6}, {5, 140}}) {
        for (const int share : {2, 40, 100000}) {
            std::vector<std::uint8_t> kind(static_cast<std::size_t>(width) * height);
            for (auto& k : kind)
                k = static_cast<std::uint8_t>((random() % share == 0 ? 1 : 0) | (random() % 40 != 0 ? 0 : 2));
            std::vector<std::int8_t> out(kind.size());
            chessboard_distances(width, height, kind.data(), scratch, out.data());
            for (int y = 0; y < height; ++y)
                for (int x = 0; x < width; ++x)
                    ASSERT_EQ(out[y * width + x], distance_to(kind, width, height, x, y, 1) -
                                                      distance_to(kind, width, height, x, y, 2))
                        << width << " x " << height << " at " << x << ", " << y;
        }
    }
}

}  // namespace
}  // namespace kinevox::kernels
