#include "server/calibration/coverage.h"

#include <algorithm>
#include <array>

namespace kinevox {

int Coverage::cell(Vec2 p) const {
    const int column = std::clamp(static_cast<int>((p.x + 0.5) * kColumns / width_), 0, kColumns - 1);
    const int row = std::clamp(static_cast<int>((p.y + 0.5) * kRows / height_), 0, kRows - 1);
    return row * kColumns + column;
}

void Coverage::add(Vec2 pixel) {
    ++counts_[cell(pixel)];
}

bool Coverage::is_new(const std::vector<Vec2>& pixels) const {
    return std::any_of(pixels.begin(), pixels.end(), [&](Vec2 p) { return counts_[cell(p)] == 0; });
}

double Coverage::fraction() const {
    const auto seen = std::count_if(counts_.begin(), counts_.end(), [](int n) { return n > 0; });
    return static_cast<double>(seen) / (kColumns * kRows);
}

std::string Coverage::emptiest() const {
    static constexpr std::array<const char*, 9> kNames{"the upper left", "the upper edge", "the upper right",
                                                       "the left edge",  "the centre",     "the right edge",
                                                       "the lower left", "the lower edge", "the lower right"};
    std::array<int, 9> empty{}, cells{};
    for (int row = 0; row < kRows; ++row)
        for (int column = 0; column < kColumns; ++column) {
            const int region = 3 * (row * 3 / kRows) + column * 3 / kColumns;
            ++cells[region];
            empty[region] += counts_[row * kColumns + column] == 0;
        }
    int worst = 0;
    for (int r = 1; r < 9; ++r)
        if (empty[r] * cells[worst] > empty[worst] * cells[r]) worst = r;
    return empty[worst] == 0 ? "" : kNames[worst];
}

}  // namespace kinevox
