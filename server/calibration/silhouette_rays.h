// The rays through outlines, and how they miss the other cameras' silhouettes.
#pragma once

#include <memory>
#include <vector>

#include "server/calibration/places_normal.h"
#include "server/calibration/silhouette_field.h"
#include "server/calibration/silhouette_refine.h"

namespace kinevox {

class OutlineRays {
  public:
    OutlineRays(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                const SilhouetteRefineOptions& options);

    std::size_t count() const { return rays_.size(); }
    int moments() const { return static_cast<int>(fields_.size()); }

    // At these places; `scale_px` is the robust kernel's (Geman-McClure). With derivatives every ray is
    // searched for the depth at which it misses least; without, those depths are followed from there, where
    // there are any. Not thread safe.
    PlacesNormal measure(const std::vector<Camera>& cameras, double scale_px, bool with_derivatives) const;

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
    // From a depth that was right for places nearby.
    Hit follow(const std::vector<Camera>& cameras, const OutlineRay& ray, double depth) const;
    // To the least of the squares next to it, by Gauss-Newton: so exactly that they are smooth in the
    // cameras' places.
    void polish(const std::vector<Camera>& cameras, const OutlineRay& ray, Hit& hit) const;
    double squares_at(const std::vector<Camera>& cameras, const OutlineRay& ray, Vec3 point) const;
    void add(const std::vector<Camera>& cameras, const OutlineRay& ray, const Hit& hit, double weight,
             PlacesNormal& normal) const;
    std::vector<Vec3> middles(const std::vector<Camera>& cameras) const;

    SilhouetteRefineOptions options_;
    double margin_px_ = 0;
    std::vector<std::vector<std::unique_ptr<SilhouetteField>>> fields_;  // [moment][camera], null: none
    std::vector<OutlineRay> rays_;
    mutable std::vector<double> depths_;  // of the last search, per ray; 0: none
};

}  // namespace kinevox
