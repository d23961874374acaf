// The box around the intersection of the cones of all silhouettes (paper 3.2, "generalized cones"), and the
// lattice laid over it.
#pragma once

#include <optional>
#include <vector>

#include "common/camera.h"
#include "common/geometry.h"
#include "kernels/types.h"

namespace kinevox {

struct Box3 {
    Vec3 min_in_world, max_in_world;  // m

    bool operator==(const Box3&) const = default;
};

// One camera's cone, bounded by the pyramid through its silhouette's box.
struct SilhouetteCone {
    const Camera* camera = nullptr;
    // px. Where it touches the picture's border the subject may go on unseen: that side bounds nothing, the
    // opposite one does. Of a subject cut on its left or right the unseen part may be higher or lower; of one
    // cut at head or feet the unseen part is taken to be at most twice as wide as what is seen.
    kernels::Rect bounds;
};

// The box around the part of `within` that lies in all pyramids; nothing if that is empty.
std::optional<Box3> box_of_cones(const std::vector<SilhouetteCone>& cones, const Box3& within);

// The lattice of whole bricks over a box, on a grid fixed in the world, so that the lattices of successive
// frames line up. Longer sides than `max_side_m` are cut around `centre`.
kernels::Lattice lattice_over(const Box3& box, double voxel_m, double max_side_m, Vec3 centre);

// The pixels that the box covers in the camera's picture, cut to the picture; empty if it does not see it.
// A box that reaches behind the camera covers the whole picture. `fraction_inside`, if given: the part of the
// projected box that lies in the picture, 0..1.
kernels::Rect projected_box(const Camera& camera, const Box3& box, double* fraction_inside = nullptr);

}  // namespace kinevox
