// Computes from a silhouette the two maps that the carver uses: signed cell distances and misses.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/hull.h"
#include "kernels/shared/hull.h"

namespace kinevox::kernels {

struct HullMapsStorage {
    HullMaps maps;  // points into the vectors below
    std::vector<std::int8_t> cells;
    std::vector<std::uint8_t> miss;
    std::vector<std::uint8_t> scratch;
};

// `block_radius_px`: approximate projected radius of the smallest blocks to be decided; determines the cell
// size. `view.silhouette` must not be null.
void make_hull_maps(const HullView& view, const Projector& camera, float miss_budget_permille,
                    float block_radius_px, HullMapsStorage& out);

// The sizes and origins of the maps, without their data (`cells` and `miss` are null): `bounds` becomes
// `silhouette_bounds` inside the image; where it is empty, both maps have one cell, which is outside.
HullMaps frame_hull_maps(const Rect& silhouette_bounds, const Projector& camera, float miss_budget_permille,
                         float block_radius_px, Rect& bounds);

// Projected radius (px) of a cube of this half edge at the lattice's centre.
float typical_block_radius_px(const Projector& camera, const Lattice& lattice, float half_edge_m);

}  // namespace kinevox::kernels
