// Renders the skinned person for one camera: 2 x 2 samples per pixel, z-buffer, no allocation in steady
// state.
#pragma once

#include <cstdint>
#include <vector>

#include "common/camera.h"
#include "server/cameras/studio/body_mesh.h"
#include "server/cameras/studio/lens.h"
#include "server/cameras/studio/triangle_cells.h"

namespace kinevox::studio {

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

    // 255 where the ray through the pixel's centre hits the person, else 0; width * height. The person's
    // surface is the same one that draw() draws.
    void mask(const Camera& camera, const BodyMesh& mesh, const SkinnedBody& body,
              std::vector<std::uint8_t>& out);

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
