#include "kernels/cpu/hull_maps.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "kernels/cpu/chessboard_distance.h"

namespace kinevox::kernels {
namespace {

// Per cell: bit 0 where any of its pixels is foreground, bit 1 where any is background. Pixels outside the
// image are neither.
void classify_cells(const HullView& view, const HullMaps& maps, std::uint8_t* kind) {
    const int width = view.camera->width, height = view.camera->height, edge = 1 << maps.cell_shift;
    const int columns =
        maps.cells_width;  // of its own: what is written may be anything, for all the compiler knows
    for (int row = 0; row < maps.cells_height; ++row) {
        std::uint8_t* out = kind + static_cast<std::size_t>(row) * columns;
        std::memset(out, 0, columns);
        const int y0 = (row + maps.cells_y0) << maps.cell_shift, y1 = std::min(y0 + edge, height);
        const int first_x = maps.cells_x0 << maps.cell_shift;
        for (int y = y0; y < y1; ++y) {
            const std::uint8_t* in = view.silhouette + static_cast<std::size_t>(y) * width + first_x;
            if (maps.cell_shift == 0) {
#pragma GCC ivdep
                for (int n = 0; n < columns; ++n) out[n] = in[n] ? 1 : 2;
                continue;
            }
            const int available = width - first_x;
            for (int n = 0; n < columns; ++n) {
                const int stop = std::min((n + 1) << maps.cell_shift, available);
                std::uint8_t seen = 0;
                for (int x = n << maps.cell_shift; x < stop; ++x) seen |= in[x] ? 1 : 2;
                out[n] |= seen;
            }
        }
    }
}

// Chessboard distances up to the budget, which is small: along rows, then along columns, as minima over a
// window; then as fractions of the budget.
void make_miss_map(const HullView& view, const Rect& bounds, HullMapsStorage& out) {
    const HullMaps& maps = out.maps;
    const int budget = maps.budget_px, rim = budget + 1;
    const int width = maps.miss_width, height = maps.miss_height, columns = bounds.width();
    const auto far = static_cast<std::uint8_t>(rim);
    const auto outside = static_cast<std::uint8_t>(kMissOutside);
    const auto at = [width](std::vector<std::uint8_t>& map, int y) {
        return map.data() + static_cast<std::size_t>(y) * width;
    };
    out.miss.assign(static_cast<std::size_t>(width) * height + kMissPadding, outside);
    if (budget > 0) out.scratch.assign(out.miss.size(), far);
    std::vector<std::uint8_t>& first = budget > 0 ? out.scratch : out.miss;
    for (int y = 0; y < bounds.height(); ++y) {
        const std::uint8_t* in =
            view.silhouette + static_cast<std::size_t>(y + bounds.y0) * view.camera->width + bounds.x0;
        std::uint8_t* row = at(first, y + rim);
        if (budget == 0) {
#pragma GCC ivdep
            for (int x = 0; x < columns; ++x) row[x + rim] = in[x] ? 0 : outside;
            continue;
        }
        for (int shift = -budget; shift <= budget; ++shift) {
            const auto distance = static_cast<std::uint8_t>(std::abs(shift));
            std::uint8_t* shifted = row + rim + shift;
#pragma GCC ivdep
            for (int x = 0; x < columns; ++x) shifted[x] = std::min(shifted[x], in[x] ? distance : far);
        }
    }
    if (budget == 0) return;
    std::uint8_t share[256];
    for (int d = 0; d < 256; ++d) share[d] = static_cast<std::uint8_t>(maps.miss_of_distance(d));
    std::vector<std::uint8_t> nearest(width);
    for (int y = 0; y < height; ++y) {
        std::fill(nearest.begin(), nearest.end(), far);
        for (int from = std::max(0, y - budget); from <= std::min(height - 1, y + budget); ++from) {
            const auto distance = static_cast<std::uint8_t>(std::abs(from - y));
            const std::uint8_t* in = at(first, from);
            for (int x = 0; x < width; ++x) nearest[x] = std::min(nearest[x], std::max(in[x], distance));
        }
        std::uint8_t* row = at(out.miss, y);
        for (int x = 0; x < width; ++x) row[x] = share[nearest[x]];
    }
}

}  // namespace

float typical_block_radius_px(const Projector& camera, const Lattice& lattice, float half_edge_m) {
    float centre[3];
    for (int axis = 0; axis < 3; ++axis) {
        centre[axis] = lattice.origin[axis] + 0.5f * lattice.voxel_m * static_cast<float>(lattice.size[axis]);
    }
    float u, v, radius;
    return cube_bound(camera, centre[0], centre[1], centre[2], half_edge_m, u, v, radius) ? radius : 1;
}

HullMaps frame_hull_maps(const Rect& silhouette_bounds, const Projector& camera, float miss_budget_permille,
                         float block_radius_px, Rect& bounds) {
    HullMaps maps;
    maps.camera = camera;
    maps.budget_px = std::clamp(static_cast<int>(miss_budget_permille * 1e-3f *
                                                 static_cast<float>(std::max(camera.width, camera.height))),
                                0, 120);
    maps.cell_shift = std::clamp(static_cast<int>(std::log2(std::max(block_radius_px, 1.f) / 5)), 0, 4);
    bounds = silhouette_bounds;
    bounds.x0 = std::max(bounds.x0, 0), bounds.y0 = std::max(bounds.y0, 0);
    bounds.x1 = std::min(bounds.x1, camera.width), bounds.y1 = std::min(bounds.y1, camera.height);
    if (bounds.empty()) {  // empty silhouette: every pixel misses
        bounds = {};
        maps.cells_width = maps.cells_height = maps.miss_width = maps.miss_height = 1;
        return maps;
    }
    const int shift = maps.cell_shift, rim = maps.budget_px + 1;
    maps.cells_x0 = bounds.x0 >> shift;
    maps.cells_y0 = bounds.y0 >> shift;
    maps.cells_width = ((bounds.x1 - 1) >> shift) + 1 - maps.cells_x0;
    maps.cells_height = ((bounds.y1 - 1) >> shift) + 1 - maps.cells_y0;
    maps.miss_x0 = bounds.x0 - rim;
    maps.miss_y0 = bounds.y0 - rim;
    maps.miss_width = bounds.width() + 2 * rim;
    maps.miss_height = bounds.height() + 2 * rim;
    return maps;
}

void make_hull_maps(const HullView& view, const Projector& camera, float miss_budget_permille,
                    float block_radius_px, HullMapsStorage& out) {
    HullMaps& maps = out.maps;
    Rect bounds;
    maps = frame_hull_maps(view.bounds, camera, miss_budget_permille, block_radius_px, bounds);
    if (bounds.empty()) {
        out.miss.assign(1 + kMissPadding, static_cast<std::uint8_t>(kMissOutside));
        out.cells.assign(1, 127);
    } else {
        const std::size_t size = static_cast<std::size_t>(maps.cells_width) * maps.cells_height;
        out.cells.resize(size);
        classify_cells(view, maps, reinterpret_cast<std::uint8_t*>(out.cells.data()));
        chessboard_distances(maps.cells_width, maps.cells_height,
                             reinterpret_cast<const std::uint8_t*>(out.cells.data()), out.scratch,
                             out.cells.data());
        make_miss_map(view, bounds, out);
    }
    maps.cells = out.cells.data();
    maps.miss = out.miss.data();
}

}  // namespace kinevox::kernels
