// The rays through outlines, and how they miss the other cameras' silhouettes.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "server/calibration/silhouette_field.h"
#include "server/calibration/silhouette_refine.h"

namespace kinevox {

class OutlineRays {
  public:
    OutlineRays(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                const SilhouetteRefineOptions& options);

    std::size_t count() const { return rays_.size(); }
    int moments() const { return static_cast<int>(fields_.size()); }

    struct Normal {
        Eigen::MatrixXd square;  // 6 cameras x 6 cameras: turn and shift of camera_from_world, from the left
        Eigen::VectorXd right;
        double cost = 0;                  // robust
        std::vector<double> camera_cost;  // mean robust miss of each camera's rays, px
    };
    // At these places; `scale_px` is the robust kernel's (Geman-McClure).
    Normal measure(const std::vector<Camera>& cameras, double scale_px, bool with_derivatives) const;

  private:
    struct OutlineRay {
        int moment, camera;
        Vec3 direction_in_camera;  // length 1
    };
    struct Hit {
        double depth = 0;
        double squares = 0;  // sum of squared misses
    };
    Hit search(const std::vector<Camera>& cameras, const OutlineRay& ray, Vec3 middle) const;
    double squares_at(const std::vector<Camera>& cameras, const OutlineRay& ray, Vec3 point) const;
    void add(const std::vector<Camera>& cameras, const OutlineRay& ray, const Hit& hit, double weight,
             Normal& normal) const;
    std::vector<Vec3> middles(const std::vector<Camera>& cameras) const;

    SilhouetteRefineOptions options_;
    double margin_px_ = 0;
    std::vector<std::vector<std::unique_ptr<SilhouetteField>>> fields_;  // [moment][camera], null: none
    std::vector<OutlineRay> rays_;
};

}  // namespace kinevox
