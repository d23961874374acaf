// The person as a triangle mesh in the rest pose: skinning weights, ambient occlusion and painted texels.
// Made once.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "server/cameras/studio/implicit_body.h"
#include "server/cameras/studio/vec3f.h"

namespace kinevox::studio {

struct TriangleMesh {
    std::vector<Vec3f> vertices;                          // m
    std::vector<std::array<std::uint32_t, 3>> triangles;  // counter-clockwise from outside
};

// Meshes the zero set of a signed distance (naive surface nets, S. Gibson 1998): one vertex per crossed cell,
// one quad per crossed edge. Closed, consistently oriented (outwards), the same whatever the thread count.
// The box [lower, upper] must contain the surface; the distance may be wrong by a factor of 2 away from it.
TriangleMesh mesh_distance(const std::function<float(Vec3f)>& distance, Vec3f lower, Vec3f upper,
                           float cell_m);

// A triangle's texel (u, v) covers barycentric (b1, b2) in [u, u+1) / 4 ...
inline constexpr int kTexelsAcross = 4;
inline constexpr int kTexelsPerTriangle = kTexelsAcross * kTexelsAcross;

// Reflectance to the power 1 / 2.2, 0..255: the sensor value in light of strength 1.
struct Texel {
    std::uint8_t b = 0, g = 0, r = 0, unused = 0;
};

struct SkinWeights {
    std::array<std::uint8_t, 4> bone{};
    std::array<float, 4> weight{};  // sum 1, largest first
};

struct BodyMesh {
    TriangleMesh surface;              // rest pose, m
    std::vector<Vec3f> normals;        // per vertex, outwards, length 1
    std::vector<SkinWeights> weights;  // per vertex
    std::vector<float>
        openness;  // per vertex, 0..1: fraction of the surroundings that the body does not occlude
    std::vector<Texel> texels;  // kTexelsPerTriangle per triangle; empty if not painted
};

struct BodyMeshOptions {
    float cell_m = 0.015f;
    bool painted = true;  // false: only shape and weights, for casting shadows
};
BodyMesh make_body_mesh(const ImplicitBody& body, const Subject& subject, const BodyMeshOptions& options);

// Reflectance of the surface point `rest`; in body_paint.cc.
Albedo paint(const ImplicitBody& body, const Subject& subject, Vec3f rest, Bone nearest);

// The mesh in a pose; vectors are reused from call to call.
struct SkinnedBody {
    std::vector<Vec3f> vertices;  // world, m
    std::vector<Vec3f> normals;   // world, length about 1
};
// Linear blend skinning. `rest_rig` is the rig in its rest pose.
void skin(const BodyMesh& mesh, const PosedRig& rest_rig, const PosedRig& posed, SkinnedBody& out);

}  // namespace kinevox::studio
