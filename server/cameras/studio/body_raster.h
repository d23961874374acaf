// Rasterises triangles, and with them the skinned person for one camera.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "common/camera.h"
#include "server/cameras/studio/body_mesh.h"
#include "server/cameras/studio/virtual_camera.h"

namespace kinevox::studio {

struct CellBounds {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  // half open, none negative
    bool empty() const { return x0 >= x1 || y0 >= y1; }
};

// Visits the integer points inside a triangle. Points within a hair of an edge belong to both neighbours, so
// that a closed mesh leaves no cracks.
// visit(x, y, b1, b2): b1, b2 are the barycentric weights of the second and third corner.
template <typename Visit>
inline void for_cells_in_triangle(float ax, float ay, float bx, float by, float cx, float cy,
                                  const CellBounds& bounds, Visit&& visit) {
    constexpr float kHair = 1e-3f, kAlmostOne = 0.9999f;
    const float low_x = std::max(std::min(ax, std::min(bx, cx)) - kHair, static_cast<float>(bounds.x0));
    const float high_x = std::min(std::max(ax, std::max(bx, cx)) + kHair, static_cast<float>(bounds.x1 - 1));
    const float low_y = std::max(std::min(ay, std::min(by, cy)) - kHair, static_cast<float>(bounds.y0));
    const float high_y = std::min(std::max(ay, std::max(by, cy)) + kHair, static_cast<float>(bounds.y1 - 1));
    if (!(low_x <= high_x && low_y <= high_y)) return;
    // Bounds are not negative, so that truncation rounds down; without SSE 4.1 ceil() and floor() are calls.
    const int x0 = static_cast<int>(low_x + kAlmostOne), x1 = static_cast<int>(high_x);
    const int y0 = static_cast<int>(low_y + kAlmostOne), y1 = static_cast<int>(high_y);
    if (x0 > x1 || y0 > y1) return;
    const float area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    if (std::abs(area) < 1e-12f) return;
    const float inv = 1.0f / area;
    // b1 = ((p - a) x (c - a)) / area, b2 = ((b - a) x (p - a)) / area.
    const float b1_dx = (cy - ay) * inv, b1_dy = -(cx - ax) * inv, b2_dx = -(by - ay) * inv,
                b2_dy = (bx - ax) * inv;
    const float px = static_cast<float>(x0) - ax;
    for (int y = y0; y <= y1; ++y) {
        const float py = static_cast<float>(y) - ay;
        float b1 = b1_dx * px + b1_dy * py, b2 = b2_dx * px + b2_dy * py;
        for (int x = x0; x <= x1; ++x, b1 += b1_dx, b2 += b2_dx)
            if (b1 >= -1e-4f && b2 >= -1e-4f && b1 + b2 <= 1.0001f) visit(x, y, b1, b2);
    }
}

// Renders the skinned person for one camera: 2 x 2 samples per pixel, z-buffer, no allocation in steady
// state.
class BodyRaster {
  public:
    // `shown_light`: per triangle, to the power 1 / 2.2, r g b.
    void draw(const Camera& camera, const BodyMesh& mesh, const SkinnedBody& body,
              const std::vector<Vec3f>& shown_light);

    // Bounding box of the person; empty if outside the image.
    const CellBounds& box() const { return box_; }

    // Blends row `y` of the person over `bgr` (width * 3 values, grey levels times kGreyScale). y within
    // box().
    void blend_row(int y, std::uint16_t* bgr) const;

    // Of the surface that the ray through the pixel's centre hits first, the label of its triangle; 0: none.
    // width * height. `labels`: per triangle. The surface is the same one that draw() draws.
    void label(const Camera& camera, const BodyMesh& mesh, const SkinnedBody& body,
               const std::vector<std::uint8_t>& labels, std::vector<std::uint8_t>& out);

  private:
    static constexpr int kSamples = 2;  // along each axis
    void project(const Camera& camera, const SkinnedBody& body);
    void fill(Vec3f a, Vec3f b, Vec3f c, float inverse_area, std::int32_t triangle, int wide, int high);

    std::vector<Vec3f> seen_;  // u, v px; depth m
    CellBounds box_;
    int stride_ = 0;            // samples from row to row: the box's width and some room, a multiple of 4
    std::vector<float> depth_;  // m, of the box's samples; infinity: nothing
    std::vector<std::int32_t> texel_;  // index into the mesh's texels
    const BodyMesh* mesh_ = nullptr;
    const std::vector<Vec3f>* light_ = nullptr;
};

}  // namespace kinevox::studio
