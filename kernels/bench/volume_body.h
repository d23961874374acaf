// A person-sized body seen by a ring of cameras, for the benchmarks of hull and colouring.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/colouring.h"
#include "kernels/hull.h"

namespace kinevox::kernels::bench {

struct Body {
    std::vector<CameraModel> cameras;  // 640 x 480 px
    std::vector<std::vector<std::uint8_t>> masks, images;
    std::vector<HullView> hull_views;
    std::vector<ColouringView> colouring_views;
};

// Capsules for trunk, head, legs and arms (arms out: a lattice of 2 x 2 x 2 m is needed), patterned.
const Body& body(int cameras, bool arms_out);

// Around the body, `span_m` wide and deep and 2 m high.
Lattice lattice_around(float voxel_m, float span_m);

}  // namespace kinevox::kernels::bench
