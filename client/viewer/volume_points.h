// A volume's surface as points to be drawn. No Qt, no OpenGL.
#pragma once

#include <cstdint>
#include <vector>

#include "common/volume.h"

namespace kinevox::viewer {

// As it lies in the graphics memory: 20 bytes.
struct SurfacePoint {
    float x = 0, y = 0, z = 0;  // m, world, a voxel's middle
    std::uint8_t r = 0, g = 0, b = 0, a = 255;
    std::int8_t nx = 0, ny = 0, nz = 127, unused = 0;  // outwards, 127 long, world
};
static_assert(sizeof(SurfacePoint) == 20);

// A point a surface voxel. Normals lead away from the voxels within three edges; without colours all are of
// one grey.
std::vector<SurfacePoint> surface_points(const Volume& volume);

}  // namespace kinevox::viewer
