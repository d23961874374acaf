// The CPU form of the moments, and what the CUDA form takes from it.
#pragma once

#include "kernels/moments.h"

namespace kinevox::kernels {

std::unique_ptr<MomentCalculator> make_moment_calculator_cpu(const MomentOptions& options);

// Whole-number sums over a mask, each pixel with its value 0..255 and its index as its place.
struct MaskSums {
    std::int64_t mass = 0, x = 0, y = 0, squares = 0;  // squares: x^2 + y^2
};

// Fills mass and mapping of `out`; false where there is nothing to compute. Throws std::invalid_argument for
// a given mapping whose radius is not positive or whose numbers are not finite.
bool map_to_disk(const MaskSums& sums, const MomentView& view, float disk_per_gyration,
                 SilhouetteMoments& out);

}  // namespace kinevox::kernels
