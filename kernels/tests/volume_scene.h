// Analytic bodies seen by a ring of cameras, for the tests of the volume's stages.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "kernels/colouring.h"
#include "kernels/hull.h"

namespace kinevox::kernels::testing {

struct Scene {
    std::vector<CameraModel> cameras;
    std::vector<std::vector<std::uint8_t>> masks;   // 0 or 255; empty: this camera has no image
    std::vector<std::vector<std::uint8_t>> images;  // B, G, R

    // Signed distance (m, negative inside) and colour of the body at a world point.
    using Distance = std::function<float(const float*)>;
    using Paint = std::function<Colour(const float*)>;

    // Sphere-traces every pixel's ray; what is not the body is `background`. Calls the functions from several
    // threads.
    void draw(const Distance& body, const Paint& paint = {}, Colour background = {});

    std::vector<HullView> hull_views() const;
    std::vector<ColouringView> colouring_views() const;
};

// Cameras of 320 x 240 or 640 x 480 px (alternating), 3 m around (0, 0, 1), looking at it from different
// heights.
Scene ring_of_cameras(int count, float k1, float k2, float p1);

float sphere_distance(const float* p, float x, float y, float z, float radius);
float box_distance(const float* p, float half_x, float half_y, float half_z);  // around (0, 0, 1)

// Around (0, 0, 1).
Lattice make_lattice(float voxel_m, int nx, int ny, int nz);

// One byte a voxel, x fastest.
std::vector<std::uint8_t> bits_of(const VoxelVolume& volume);

}  // namespace kinevox::kernels::testing
