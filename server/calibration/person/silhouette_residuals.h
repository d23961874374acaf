// Residuals of silhouettes at given camera poses: rays through contours (contour_ray_cost.cc) and tangent
// planes (silhouette_tangents.cc).
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "common/camera.h"
#include "server/calibration/person/silhouette_hull.h"
#include "server/calibration/person/silhouette_refine.h"
#include "server/silhouettes/silhouettes.h"

namespace kinevox {

// In all camera poses, the sum over several kinds of observations.
struct PoseNormalEquations {
    Eigen::MatrixXd
        square;  // 6 cameras x 6 cameras: left rotation and translation increments of camera_from_world
    Eigen::VectorXd right;
    double cost = 0;                  // robust
    std::vector<double> camera_cost;  // mean robust residual of each camera's observations, px
};

// Rays through silhouette contours against the other cameras' silhouettes.
class ContourRayCost {
  public:
    ContourRayCost(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                   const SilhouetteRefineOptions& options);

    std::size_t count() const { return rays_.size(); }
    int frame_sets() const { return static_cast<int>(fields_.size()); }

    // Cost at these poses; `scale_px` is the scale of the robust kernel (Geman-McClure). With derivatives,
    // the depth of every ray is searched for the smallest residual; without, the last depths are tracked if
    // there are any. Not thread safe.
    PoseNormalEquations measure(const std::vector<Camera>& cameras, double scale_px,
                                bool with_derivatives) const;

  private:
    struct ContourRay {
        int frame_set, camera;
        Vec3 direction_in_camera;  // length 1
    };
    struct Hit {
        double depth = 0;
        double squares = 0;  // sum of squared residuals
    };
    Hit search(const std::vector<Camera>& cameras, const ContourRay& ray, Vec3 middle) const;
    // From a depth that was right for poses nearby.
    Hit follow(const std::vector<Camera>& cameras, const ContourRay& ray, double depth) const;
    // Gauss-Newton to the nearby minimum, exact enough for the cost to be smooth in the camera poses.
    void polish(const std::vector<Camera>& cameras, const ContourRay& ray, Hit& hit) const;
    double squares_at(const std::vector<Camera>& cameras, const ContourRay& ray, Vec3 point) const;
    void add(const std::vector<Camera>& cameras, const ContourRay& ray, const Hit& hit, double weight,
             PoseNormalEquations& normal) const;
    std::vector<Vec3> centres(const std::vector<Camera>& cameras) const;

    SilhouetteRefineOptions options_;
    double margin_px_ = 0;
    std::vector<std::vector<std::unique_ptr<SilhouetteField>>> fields_;  // [frame set][camera], null: none
    std::vector<ContourRay> rays_;
    mutable std::vector<double> depths_;  // of the last search, per ray; 0: none
};

// Epipolar tangency: planes through two camera centres that touch the subject touch both silhouettes. The
// planes tangent above and below are the same seen from either camera, whatever the subject's shape. This
// constrains pairs of cameras that see the subject from any but opposite sides.

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
