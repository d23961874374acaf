// Signed distance field of a silhouette.
#pragma once

#include <cstdint>
#include <vector>

#include "common/geometry.h"

namespace kinevox {

class SilhouetteField {
  public:
    // Cells of one pixel, two in large images.
    SilhouetteField(const std::vector<std::uint8_t>& mask, int width, int height);

    bool empty() const { return cells_.empty(); }
    // px, positive inside the silhouette, bilinear between cells. NaN outside the image.
    float distance(float x, float y) const;
    // The same with its gradient.
    float distance(float x, float y, float& dx, float& dy) const;
    // About `count` points, evenly along the contour.
    std::vector<Vec2> contour(int count) const;
    // Bounding box, px.
    float left = 0, top = 0, right = 0, bottom = 0;

  private:
    int width_ = 0, height_ = 0, columns_ = 0, rows_ = 0;
    float step_ = 1;
    std::vector<float> cells_;
    std::vector<Vec2> edge_;
};

}  // namespace kinevox
