// Fraction of a camera's image in which target points were detected.
#pragma once

#include <string>
#include <vector>

#include "common/geometry.h"

namespace kinevox {

class Coverage {
  public:
    static constexpr int kColumns = 8, kRows = 6;

    Coverage(int width, int height) : width_(width), height_(height), counts_(kColumns * kRows, 0) {}

    void add(Vec2 pixel);
    // True if any of them lies in an empty cell.
    bool is_new(const std::vector<Vec2>& pixels) const;
    // Non-empty cells, 0 to 1.
    double fraction() const;
    // Points per cell, row by row from the upper left.
    const std::vector<int>& counts() const { return counts_; }
    // Name of the image region with the most empty cells: "the upper left"; empty at full coverage.
    std::string emptiest() const;

  private:
    int cell(Vec2 pixel) const;
    int width_, height_;
    std::vector<int> counts_;
};

}  // namespace kinevox
