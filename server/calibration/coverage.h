// Which parts of a camera's picture were seen by corners.
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
    // Whether any of them lies in a cell that has none.
    bool is_new(const std::vector<Vec2>& pixels) const;
    // Of the cells, 0 to 1.
    double part() const;
    // Corners in each cell, row by row from the upper left.
    const std::vector<int>& counts() const { return counts_; }
    // The emptiest of the picture's regions in words: "the upper left"; empty where nothing is missing.
    std::string emptiest() const;

  private:
    int cell(Vec2 pixel) const;
    int width_, height_;
    std::vector<int> counts_;
};

}  // namespace kinevox
