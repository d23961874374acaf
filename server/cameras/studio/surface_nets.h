// Meshes the zero set of a signed distance (naive surface nets, S. Gibson 1998): one vertex per crossed cell,
// one quad per crossed edge. Closed, consistently oriented (outwards), the same whatever the thread count.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "server/cameras/studio/vec3f.h"

namespace kinevox::studio {

struct TriangleMesh {
    std::vector<Vec3f> vertices;                          // m
    std::vector<std::array<std::uint32_t, 3>> triangles;  // counter-clockwise from outside
};

// The box [lower, upper] must contain the surface; the distance may be wrong by a factor of 2 away from it.
TriangleMesh mesh_distance(const std::function<float(Vec3f)>& distance, Vec3f lower, Vec3f upper,
                           float cell_m);

}  // namespace kinevox::studio
