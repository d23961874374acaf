// The distance map against the nearest cell of the other kind, searched among all.
#include "kernels/distance_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

namespace kinevox::kernels {
namespace {

std::vector<float> searched(const std::vector<std::uint8_t>& inside, int columns, int rows) {
    std::vector<float> distance(inside.size());
    for (int n = 0; n < columns * rows; ++n) {
        float nearest = 1e9f;
        for (int row = 0; row < rows; ++row)
            for (int column = 0; column < columns; ++column) {
                if ((inside[row * columns + column] != 0) == (inside[n] != 0)) continue;
                const int across = column - n % columns, down = row - n / columns;
                nearest = std::min(nearest, std::hypot(static_cast<float>(across), static_cast<float>(down)));
            }
        distance[n] = inside[n] ? nearest - 0.5f : 0.5f - nearest;
    }
    return distance;
}

TEST(DistanceMap, IsExactForShapesOfEverySizeAndForScatteredCells) {
    std::mt19937 random(5);
    for (const auto& [columns, rows] :
         {std::pair{1, 9}, {9, 1}, {2, 2}, {5, 40}, {17, 16}, {33, 50}, {64, 20}})
        for (const double share : {0.02, 0.5, 0.98}) {
            std::bernoulli_distribution is_inside(share);
            std::vector<std::uint8_t> inside(static_cast<std::size_t>(columns) * rows);
            for (std::uint8_t& cell : inside) cell = is_inside(random) ? 255 : 0;
            ASSERT_GE(inside.size(), 2u);
            inside.front() = 1, inside.back() = 0;
            std::vector<float> distance(inside.size());
            signed_distances(inside.data(), columns, rows, distance.data());
            const std::vector<float> expected = searched(inside, columns, rows);
            for (std::size_t n = 0; n < inside.size(); ++n)
                ASSERT_NEAR(distance[n], expected[n], 1e-5f)
                    << columns << " x " << rows << ", " << share << ", cell " << n;
        }
}

TEST(DistanceMap, IsFarEverywhereIfAllCellsAreOfOneKind) {
    for (const std::uint8_t kind : {0, 1}) {
        const std::vector<std::uint8_t> inside(12, kind);
        std::vector<float> distance(inside.size());
        signed_distances(inside.data(), 4, 3, distance.data());
        for (const float d : distance) EXPECT_GE(kind ? d : -d, kMaxDistanceMapSide - 1.f);
    }
}

TEST(DistanceMap, RefusesAGridThatIsEmptyOrTooLarge) {
    const std::uint8_t inside = 1;
    float distance = 0;
    EXPECT_THROW(signed_distances(&inside, 0, 1, &distance), std::invalid_argument);
    EXPECT_THROW(signed_distances(&inside, 1, kMaxDistanceMapSide + 1, &distance), std::invalid_argument);
}

}  // namespace
}  // namespace kinevox::kernels
