// Epipolar tangency: planes through two camera centres that touch the subject touch both silhouettes. The
// planes tangent above and below are the same seen from either camera, whatever the subject's shape. This
// constrains pairs of cameras that see the subject from any but opposite sides.
#pragma once

#include <vector>

#include "common/camera.h"
#include "server/calibration/person/pose_normal_equations.h"
#include "server/silhouettes/silhouette_set.h"

namespace kinevox {

class SilhouetteTangents {
  public:
    // Uses all frame sets of `silhouettes`: tangents are cheap.
    SilhouetteTangents(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes);

    // Residuals between the planes, px in the images, at these poses; `scale_px` is the scale of the robust
    // kernel (Geman-McClure). `first`, `last`: range of frame sets; 0 and frame_sets() for all.
    PoseNormalEquations measure(const std::vector<Camera>& cameras, double scale_px, bool with_derivatives,
                                std::size_t first, std::size_t last) const;
    PoseNormalEquations measure(const std::vector<Camera>& cameras, double scale_px,
                                bool with_derivatives) const {
        return measure(cameras, scale_px, with_derivatives, 0, frame_sets());
    }
    std::size_t frame_sets() const { return shapes_.size(); }

  private:
    // The convex hull of a silhouette: only its points can touch a plane from outside.
    struct Shape {
        std::vector<Vec3> directions_in_camera;  // length 1
        std::vector<bool> at_border;             // the image ends there, the subject may not
    };
    struct Touch {
        const Vec3* direction_in_camera = nullptr;  // null: no reliable one
        Vec3 direction_in_world;
        double off_axis = 0;  // sine of the angle between the direction and the baseline
    };
    // Adds the residuals of cameras a and b in one frame set; counts them per camera. `scale2`: scale_px
    // squared.
    void add_pair(const std::vector<Camera>& cameras, std::size_t frame_set, int a, int b, double scale2,
                  bool with_derivatives, PoseNormalEquations& part, std::vector<double>& counts) const;
    static void touch(const Shape& shape, const Camera& camera, Vec3 axis, Vec3 reference, Touch (&ends)[2]);

    std::vector<std::vector<Shape>> shapes_;  // [frame set][camera], empty: none
};

}  // namespace kinevox
