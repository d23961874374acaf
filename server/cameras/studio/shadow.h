// Shadows of the person: the key lamp's on the floor (sharp at the feet, soft further up), the dark patch
// under feet and hands, and the key lamp's on the body itself.
#pragma once

#include <vector>

#include "server/cameras/studio/body_mesh.h"
#include "server/cameras/studio/body_raster.h"
#include "server/cameras/studio/room.h"

namespace kinevox::studio {

// Shadow on the floor as a factor on sensor values (light to the power 1 / 2.2), on a square that moves with
// the person in whole cells.
class FloorShadow {
  public:
    static constexpr int kCells = 200;
    static constexpr float kCell_m = 0.03f;

    void cast(const TriangleMesh& surface, const std::vector<Vec3f>& vertices, const Lighting& lighting);

    bool empty() const { return dark_.empty(); }
    // World metres of the rectangle that is darker than the empty floor.
    void extent(float& x0, float& y0, float& x1, float& y1) const;
    // 1 outside. x, y: world metres; NaN gives 1.
    float factor(float x, float y) const {
        const float u = (x - origin_x_) * (1 / kCell_m), v = (y - origin_y_) * (1 / kCell_m);
        if (!(u >= static_cast<float>(dark_.x0) && v >= static_cast<float>(dark_.y0) &&
              u < static_cast<float>(dark_.x1 - 1) && v < static_cast<float>(dark_.y1 - 1)))
            return 1.0f;
        const int i = static_cast<int>(u), j = static_cast<int>(v);
        const float fu = u - i, fv = v - j;
        const float* row = &factor_[static_cast<std::size_t>(j) * kCells + i];
        return (1 - fv) * ((1 - fu) * row[0] + fu * row[1]) +
               fv * ((1 - fu) * row[kCells] + fu * row[kCells + 1]);
    }

  private:
    struct Layer {
        std::vector<float> cover;  // kCells^2, 0..1
        CellBounds box;
        void clear();
        void mark(int x, int y, float value);
        void blur(int radius, std::vector<float>& scratch);
    };
    float origin_x_ = 0, origin_y_ = 0;  // m, centre of cell (0, 0)
    std::vector<float> factor_, scratch_;
    Layer layers_[4];  // of the key lamp: three heights; under the body
    CellBounds dark_;
};

// Depth of the person as seen from the key lamp.
class BodyShadow {
  public:
    void cast(const TriangleMesh& surface, const std::vector<Vec3f>& vertices, Vec3f lamp);
    // Fraction of the lamp visible from p, 0..1.
    float lit(Vec3f p) const;

  private:
    static constexpr int kCells = 176;
    Vec3f seen_from_lamp(Vec3f p) const;  // x, y in cells, z: m along the axis
    Vec3f lamp_, right_, up_, axis_;
    float scale_ = 1, shift_x_ = 0, shift_y_ = 0;
    std::vector<float> depth_;
    std::vector<Vec3f> seen_;
};

}  // namespace kinevox::studio
