#include "server/cameras/studio/surface_nets.h"

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

}  // namespace kinevox::studio
