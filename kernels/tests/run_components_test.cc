#include "kernels/cpu/run_components.h"

#include <gtest/gtest.h>

#include <random>
#include <utility>
#include <vector>

namespace kinevox::kernels::cpu {
namespace {

using Runs = std::vector<std::pair<int, int>>;

Runs runs_pixel_by_pixel(const std::vector<std::uint8_t>& row, int x, int end, bool set) {
    Runs runs;
    for (; x < end; ++x) {
        if ((row[x] != 0) != set) continue;
        if (runs.empty() || runs.back().second != x) runs.push_back({x, x});
        runs.back().second = x + 1;
    }
    return runs;
}

TEST(RunComponents, FindsRunsOfAnyLengthAndPosition) {
    std::mt19937 random(5);
    for (int round = 0; round < 400; ++round) {
        const int width = 1 + static_cast<int>(random() % 300), longest = 1 << random() % 9;
        std::vector<std::uint8_t> row(width);
        for (int x = 0, value = 0; x < width; value = !value)
            for (int left = 1 + static_cast<int>(random() % longest); left > 0 && x < width; --left)
                row[x++] = static_cast<std::uint8_t>(value ? 1 + random() % 255 : 0);
        const int begin = static_cast<int>(random() % width);
        const int end = begin + static_cast<int>(random() % (width - begin + 1));
        Runs set, unset;
        for_each_run(row.data(), begin, end, [&](int x0, int x1) { set.push_back({x0, x1}); });
        for_each_run<false>(row.data(), begin, end, [&](int x0, int x1) { unset.push_back({x0, x1}); });
        ASSERT_EQ(set, runs_pixel_by_pixel(row, begin, end, true)) << "round " << round;
        ASSERT_EQ(unset, runs_pixel_by_pixel(row, begin, end, false)) << "round " << round;
    }
}

}  // namespace
}  // namespace kinevox::kernels::cpu
