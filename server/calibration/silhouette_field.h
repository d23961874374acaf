// A silhouette as a field of distances, cheap to ask at any place.
#pragma once

#include <cstdint>
#include <vector>

#include "common/geometry.h"

namespace kinevox {

class SilhouetteField {
  public:
    // Cells of a pixel, of two in large pictures.
    SilhouetteField(const std::vector<std::uint8_t>& mask, int width, int height);

    bool empty() const { return cells_.empty(); }
    // px, positive inside the silhouette, negative outside, bilinear between cells. NaN outside the picture.
    float distance(float x, float y) const;
    // The same and its slope.
    float distance(float x, float y, float& dx, float& dy) const;
    // Points on the outline, evenly along it, about `count`.
    std::vector<Vec2> outline(int count) const;
    // Box around the silhouette, px.
    float left = 0, top = 0, right = 0, bottom = 0;

  private:
    int width_ = 0, height_ = 0, columns_ = 0, rows_ = 0;
    float step_ = 1;
    std::vector<float> cells_;
    std::vector<Vec2> edge_;
};

}  // namespace kinevox
