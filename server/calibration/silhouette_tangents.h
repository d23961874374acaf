// Planes through two cameras' centres that touch the subject touch both silhouettes. What touches above and
// below must be the same planes seen from either camera: exact wherever a camera sees the subject's extreme
// points, and without any idea of its shape. It ties pairs of cameras that face the subject from any sides
// but opposite ones.
#pragma once

#include <vector>

#include "common/camera.h"
#include "server/calibration/places_normal.h"
#include "server/calibration/silhouette_set.h"

namespace kinevox {

class SilhouetteTangents {
  public:
    // All moments of `silhouettes` count: tangents are cheap.
    SilhouetteTangents(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes);

    // How far the planes miss each other, px in the pictures, at these places; `scale_px` is the robust
    // kernel's (Geman-McClure). `first`, `last`: only these moments, for all give 0 and moments().
    PlacesNormal measure(const std::vector<Camera>& cameras, double scale_px, bool with_derivatives,
                         std::size_t first, std::size_t last) const;
    PlacesNormal measure(const std::vector<Camera>& cameras, double scale_px, bool with_derivatives) const {
        return measure(cameras, scale_px, with_derivatives, 0, moments());
    }
    std::size_t moments() const { return shapes_.size(); }

  private:
    // The convex hull of a silhouette: nothing else can touch a plane from outside.
    struct Shape {
        std::vector<Vec3> directions_in_camera;  // length 1
        std::vector<bool> at_border;             // the picture ends there, the subject may not
    };
    struct Touch {
        const Vec3* direction_in_camera = nullptr;  // null: none that can be trusted
        Vec3 direction_in_world;
        double off_axis = 0;  // sine of the angle between the direction and the line through both centres
    };
    static void touch(const Shape& shape, const Camera& camera, Vec3 axis, Vec3 reference, Touch (&ends)[2]);

    std::vector<std::vector<Shape>> shapes_;  // [moment][camera], empty: none
};

}  // namespace kinevox
