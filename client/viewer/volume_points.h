// The surface of a volume as points for drawing. No Qt, no OpenGL.
#pragma once

#include <cstdint>
#include <vector>

#include "common/volume.h"

namespace kinevox::viewer {

// Layout in graphics memory: 20 bytes.
struct SurfacePoint {
    float x = 0, y = 0, z = 0;  // m, world, centre of the voxel
    std::uint8_t r = 0, g = 0, b = 0, a = 255;
    std::int8_t nx = 0, ny = 0, nz = 127, unused = 0;  // outwards, 127 long, world
};
static_assert(sizeof(SurfacePoint) == 20);

// One point per surface voxel. Normals point away from the voxels within a radius of three; without colours
// all points are grey.
std::vector<SurfacePoint> surface_points(const Volume& volume);

}  // namespace kinevox::viewer
