// Residuals of rays through silhouette contours against the other cameras' silhouettes.
#pragma once

#include <memory>
#include <vector>

#include "server/calibration/person/pose_normal_equations.h"
#include "server/calibration/person/silhouette_field.h"
#include "server/calibration/person/silhouette_refine.h"

namespace kinevox {

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

}  // namespace kinevox
