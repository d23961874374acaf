// The box around the intersection of the cones of all silhouettes (paper 3.2, "generalized cones"), and the
// lattice over it.
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
    // px. A side at the image border does not bound the subject, which may extend beyond; the opposite side
    // does. Of a subject truncated on its left or right the unseen rest may be higher or lower; truncated at
    // head or feet, it is assumed to be at most twice as wide as the visible rest.
    kernels::Rect bounds;
};

// The box around the intersection of `within` and all pyramids; empty if that is empty.
std::optional<Box3> box_of_cones(const std::vector<SilhouetteCone>& cones, const Box3& within);

// The lattice of whole bricks over a box, on a grid fixed in the world, so that the lattices of successive
// frames are aligned. Sides longer than `max_side_m` are cropped around `centre`.
kernels::Lattice lattice_over(const Box3& box, double voxel_m, double max_side_m, Vec3 centre);

Box3 box_of(const kernels::Lattice& lattice);

// The pixels that the box covers in the camera's image, cropped to the image; empty outside its view. A box
// that extends behind the camera covers the whole image. `fraction_inside`, if given: fraction of the
// projected box inside the image, 0..1.
kernels::Rect projected_box(const Camera& camera, const Box3& box, double* fraction_inside = nullptr);

// Whether a point's pixel lies in the camera's image.
bool shows(const Camera& camera, Vec3 in_world);

// The part of a silhouette's bounds to which a box can project, with a margin for distortion.
kernels::Rect cropped_to(const kernels::Rect& bounds, const Camera& camera, const Box3& box);

// Of a body to a camera that predicts its motion.
inline constexpr double kMinPartDistance_m = 0.3;

// Of a volume whose legs are complete.
inline constexpr double kMaxFeetHeight_m = 0.25;

// Of the feet from the centre of gravity, to all sides.
inline constexpr double kMaxStride_m = 0.6;

// Where the legs of a body are that its volume lacks below this height, since a person stands on the floor:
// legs that look like it. Empty where no more than the feet are missing.
std::optional<Box3> missing_legs_space(Vec3 centre_in_world, double missing_below_m);

// Below this fraction of a subject, or of the box around it, inside its image, a camera need not see the
// subject.
inline constexpr double kMinExpectedInside = 0.5;

// Of the box's corners along the camera's axis, m; negative behind it.
double nearest_depth(const Camera& camera, const Box3& box);

// Whether two rectangles share a pixel.
inline bool overlap(const kernels::Rect& a, const kernels::Rect& b) {
    return a.x0 < b.x1 && b.x0 < a.x1 && a.y0 < b.y1 && b.y0 < a.y1;
}

}  // namespace kinevox
