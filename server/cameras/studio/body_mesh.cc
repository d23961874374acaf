#include "server/cameras/studio/body_mesh.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace kinevox::studio {
namespace {

struct Grid {
    int nx, ny, nz;
    Vec3f lower;
    float cell;
    std::vector<float> value;  // at the cells' corners

    std::size_t index(int i, int j, int k) const { return (static_cast<std::size_t>(k) * ny + j) * nx + i; }
    Vec3f point(int i, int j, int k) const {
        return lower + cell * Vec3f{static_cast<float>(i), static_cast<float>(j), static_cast<float>(k)};
    }
};

// Whole blocks far from the surface get their centre's value.
void sample_grid(Grid& grid, const std::function<float(Vec3f)>& distance) {
    constexpr int kBlock = 8;
    const auto blocks = [](int n) { return (n + kBlock - 1) / kBlock; };
    const float radius = 0.5f * kBlock * grid.cell * std::sqrt(3.0f);
    tbb::parallel_for(0, blocks(grid.nz), [&](int bk) {
        for (int bj = 0; bj < blocks(grid.ny); ++bj)
            for (int bi = 0; bi < blocks(grid.nx); ++bi) {
                const int i0 = bi * kBlock, j0 = bj * kBlock, k0 = bk * kBlock;
                const Vec3f middle =
                    grid.point(i0, j0, k0) + 0.5f * grid.cell * Vec3f{kBlock, kBlock, kBlock};
                const float at_centre = distance(middle);
                const bool far = std::abs(at_centre) > 2.2f * radius;
                for (int k = k0; k < std::min(k0 + kBlock, grid.nz); ++k)
                    for (int j = j0; j < std::min(j0 + kBlock, grid.ny); ++j)
                        for (int i = i0; i < std::min(i0 + kBlock, grid.nx); ++i)
                            grid.value[grid.index(i, j, k)] = far ? at_centre : distance(grid.point(i, j, k));
            }
    });
}

constexpr float kWeightFalloff_m = 0.020f;
constexpr int kSmoothingRounds = 3;

using BoneWeights = std::array<float, kBoneCount>;

// Falloff of a bone's weight with its distance beyond that of the nearest bone.
BoneWeights nearness_weights(const ImplicitBody& body, Vec3f rest) {
    float distance[kBoneCount];
    body.bone_distances(rest, distance);
    const float nearest = *std::min_element(std::begin(distance), std::end(distance));
    BoneWeights weights;
    float sum = 0;
    for (int b = 0; b < kBoneCount; ++b)
        sum += weights[b] = std::exp((nearest - distance[b]) / kWeightFalloff_m);
    for (float& w : weights) w /= sum;
    return weights;
}

std::vector<std::vector<std::uint32_t>> vertex_neighbours(const TriangleMesh& mesh) {
    std::vector<std::vector<std::uint32_t>> neighbours(mesh.vertices.size());
    for (const auto& t : mesh.triangles)
        for (int e = 0; e < 3; ++e) neighbours[t[e]].push_back(t[(e + 1) % 3]);
    return neighbours;
}

std::vector<SkinWeights> make_weights(const ImplicitBody& body, const TriangleMesh& mesh) {
    const std::size_t n = mesh.vertices.size();
    std::vector<BoneWeights> weights(n), smoothed(n);
    tbb::parallel_for(std::size_t{0}, n,
                      [&](std::size_t i) { weights[i] = nearness_weights(body, mesh.vertices[i]); });
    const auto neighbours = vertex_neighbours(mesh);
    for (int round = 0; round < kSmoothingRounds; ++round) {
        for (std::size_t i = 0; i < n; ++i) {
            BoneWeights mean{};
            for (std::uint32_t j : neighbours[i])
                for (int b = 0; b < kBoneCount; ++b) mean[b] += weights[j][b];
            const float share = 0.5f / static_cast<float>(std::max<std::size_t>(neighbours[i].size(), 1));
            for (int b = 0; b < kBoneCount; ++b) smoothed[i][b] = 0.5f * weights[i][b] + share * mean[b];
        }
        weights.swap(smoothed);
    }
    std::vector<SkinWeights> out(n);
    for (std::size_t i = 0; i < n; ++i) {
        std::array<int, kBoneCount> order;
        for (int b = 0; b < kBoneCount; ++b) order[b] = b;
        std::partial_sort(order.begin(), order.begin() + 4, order.end(), [&](int a, int b) {
            return weights[i][a] != weights[i][b] ? weights[i][a] > weights[i][b] : a < b;
        });
        float sum = 0;
        for (int k = 0; k < 4; ++k) sum += weights[i][order[k]];
        for (int k = 0; k < 4; ++k) {
            out[i].bone[k] = static_cast<std::uint8_t>(order[k]);
            out[i].weight[k] = weights[i][order[k]] / sum;
        }
    }
    return out;
}

Vec3f gradient(const ImplicitBody& body, Vec3f p, float step) {
    return normalized({body.distance({p.x + step, p.y, p.z}) - body.distance({p.x - step, p.y, p.z}),
                       body.distance({p.x, p.y + step, p.z}) - body.distance({p.x, p.y - step, p.z}),
                       body.distance({p.x, p.y, p.z + step}) - body.distance({p.x, p.y, p.z - step})});
}

// Ambient occlusion from distances along the normal (after I. Quilez).
float openness_at(const ImplicitBody& body, Vec3f p, Vec3f normal) {
    float closed = 0, weight = 1.0f;
    for (float step : {0.03f, 0.07f, 0.13f, 0.22f}) {
        closed += weight * std::max(0.0f, step - body.distance(p + step * normal)) / step;
        weight *= 0.65f;
    }
    return std::max(0.25f, 1.0f - 0.42f * closed);
}

std::uint8_t encode(float reflectance) {
    return static_cast<std::uint8_t>(
        std::clamp(255.0f * std::pow(reflectance, 1 / 2.2f) + 0.5f, 0.0f, 255.0f));
}

}  // namespace

TriangleMesh mesh_distance(const std::function<float(Vec3f)>& distance, Vec3f lower, Vec3f upper,
                           float cell_m) {
    Grid grid;
    grid.lower = lower;
    grid.cell = cell_m;
    grid.nx = static_cast<int>((upper.x - lower.x) / cell_m) + 2;
    grid.ny = static_cast<int>((upper.y - lower.y) / cell_m) + 2;
    grid.nz = static_cast<int>((upper.z - lower.z) / cell_m) + 2;
    grid.value.resize(static_cast<std::size_t>(grid.nx) * grid.ny * grid.nz);
    sample_grid(grid, distance);

    TriangleMesh mesh;
    std::vector<std::int32_t> vertex_of_cell(grid.value.size(), -1);
    for (int k = 0; k + 1 < grid.nz; ++k)
        for (int j = 0; j + 1 < grid.ny; ++j)
            for (int i = 0; i + 1 < grid.nx; ++i) {
                float corner[8];
                int inside = 0;
                for (int c = 0; c < 8; ++c) {
                    corner[c] = grid.value[grid.index(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2))];
                    inside += corner[c] < 0;
                }
                if (inside == 0 || inside == 8) continue;
                Vec3f sum;  // mean of the crossings of the twelve edges
                int crossings = 0;
                for (int axis = 0; axis < 3; ++axis)
                    for (int c = 0; c < 8; ++c) {
                        if (c >> axis & 1) continue;
                        const int other = c | 1 << axis;
                        if ((corner[c] < 0) == (corner[other] < 0)) continue;
                        const float t = corner[c] / (corner[c] - corner[other]);
                        Vec3f p{static_cast<float>(c & 1), static_cast<float>(c >> 1 & 1),
                                static_cast<float>(c >> 2)};
                        (axis == 0 ? p.x : axis == 1 ? p.y : p.z) += t;
                        sum += p;
                        ++crossings;
                    }
                vertex_of_cell[grid.index(i, j, k)] = static_cast<std::int32_t>(mesh.vertices.size());
                mesh.vertices.push_back(grid.point(i, j, k) + (cell_m / static_cast<float>(crossings)) * sum);
            }
    const auto quad = [&](std::size_t a, std::size_t b, std::size_t c, std::size_t d, bool flip) {
        std::uint32_t v[4] = {
            static_cast<std::uint32_t>(vertex_of_cell[a]), static_cast<std::uint32_t>(vertex_of_cell[b]),
            static_cast<std::uint32_t>(vertex_of_cell[c]), static_cast<std::uint32_t>(vertex_of_cell[d])};
        if (flip) std::swap(v[1], v[3]);
        mesh.triangles.push_back({v[0], v[1], v[2]});
        mesh.triangles.push_back({v[0], v[2], v[3]});
    };
    for (int k = 1; k + 1 < grid.nz; ++k)
        for (int j = 1; j + 1 < grid.ny; ++j)
            for (int i = 1; i + 1 < grid.nx; ++i) {
                const bool here = grid.value[grid.index(i, j, k)] < 0;
                const auto cell = [&](int di, int dj, int dk) { return grid.index(i - di, j - dj, k - dk); };
                if (here != (grid.value[grid.index(i + 1, j, k)] < 0))
                    quad(cell(0, 1, 1), cell(0, 0, 1), cell(0, 0, 0), cell(0, 1, 0), !here);
                if (here != (grid.value[grid.index(i, j + 1, k)] < 0))
                    quad(cell(1, 0, 1), cell(1, 0, 0), cell(0, 0, 0), cell(0, 0, 1), !here);
                if (here != (grid.value[grid.index(i, j, k + 1)] < 0))
                    quad(cell(1, 1, 0), cell(0, 1, 0), cell(0, 0, 0), cell(1, 0, 0), !here);
            }
    return mesh;
}

BodyMesh make_body_mesh(const ImplicitBody& body, const Subject& subject, const BodyMeshOptions& options) {
    BodyMesh mesh;
    mesh.surface =
        mesh_distance([&](Vec3f p) { return body.distance(p); }, body.lower(), body.upper(), options.cell_m);
    mesh.weights = make_weights(body, mesh.surface);
    const std::vector<Vec3f>& vertices = mesh.surface.vertices;
    mesh.normals.resize(vertices.size());
    mesh.openness.assign(vertices.size(), 1.0f);
    tbb::parallel_for(std::size_t{0}, vertices.size(), [&](std::size_t i) {
        mesh.normals[i] = gradient(body, vertices[i], 0.5f * options.cell_m);
        if (options.painted) mesh.openness[i] = openness_at(body, vertices[i], mesh.normals[i]);
    });
    if (!options.painted) return mesh;

    const auto& triangles = mesh.surface.triangles;
    mesh.texels.resize(triangles.size() * kTexelsPerTriangle);
    tbb::parallel_for(std::size_t{0}, triangles.size(), [&](std::size_t t) {
        const Vec3f a = vertices[triangles[t][0]], b = vertices[triangles[t][1]],
                    c = vertices[triangles[t][2]];
        for (int u = 0; u < kTexelsAcross; ++u)
            for (int v = 0; u + v < kTexelsAcross; ++v) {
                const float b1 = (static_cast<float>(u) + 0.33f) / kTexelsAcross;
                const float b2 = (static_cast<float>(v) + 0.33f) / kTexelsAcross;
                const Vec3f p = (1 - b1 - b2) * a + b1 * b + b2 * c;
                const Albedo albedo = paint(body, subject, p, body.sample(p).nearest);
                mesh.texels[t * kTexelsPerTriangle + u * kTexelsAcross + v] = {
                    encode(albedo.b), encode(albedo.g), encode(albedo.r), 0};
            }
    });
    return mesh;
}

void skin(const BodyMesh& mesh, const PosedRig& rest_rig, const PosedRig& posed, SkinnedBody& out) {
    std::array<Affine3f, kBoneCount> world_from_rest;
    for (int b = 0; b < kBoneCount; ++b)
        world_from_rest[b] = to_float(posed.world_from_bone[b] * rest_rig.world_from_bone[b].inverse());
    const std::size_t n = mesh.surface.vertices.size();
    out.vertices.resize(n);
    out.normals.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
        const SkinWeights& w = mesh.weights[i];
        Affine3f blend;
        const Affine3f& first = world_from_rest[w.bone[0]];
        for (int c = 0; c < 12; ++c) blend.m[c] = w.weight[0] * first.m[c];
        for (int k = 1; k < 4 && w.weight[k] > 0; ++k) {
            const Affine3f& bone = world_from_rest[w.bone[k]];
            for (int c = 0; c < 12; ++c) blend.m[c] += w.weight[k] * bone.m[c];
        }
        out.vertices[i] = blend.point(mesh.surface.vertices[i]);
        out.normals[i] = blend.direction(mesh.normals[i]);
    }
}

}  // namespace kinevox::studio
