// The exact visual hull of one frame set, without voxels: point queries against the silhouettes.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/calibration/person/silhouette_field.h"
#include "server/silhouettes/silhouette_set.h"

namespace kinevox {

class SilhouetteHull {
  public:
    // `cameras` must outlive it. Cameras with an empty mask are ignored.
    SilhouetteHull(const std::vector<Camera>& cameras, const std::vector<SilhouetteMask>& images);

    // True if two or more silhouettes intersect; required by all other methods.
    bool usable() const { return middle_.has_value(); }
    Vec3 middle() const { return *middle_; }  // approximate centre of the subject, m
    const SilhouetteField* field(std::size_t camera) const { return fields_[camera].get(); }

    enum class Meets { kYes, kNo, kUnseen };
    // Whether the ray through a pixel of camera `own` intersects all other silhouettes at one point, within
    // `radius_m` of the centre; kUnseen if too few of them see any point of it.
    Meets meets(std::size_t own, const Ray& ray, double radius_m, double step_m) const;

    // The hull's lowest and highest point along `up` (world, length 1), on rays through the contours, m;
    // empty for an empty hull. The hull extends a little below the feet and above the head: below soles of
    // width `w` by about w / 2 times the tangent of the cameras' downward angle.
    struct Extent {
        Vec3 lowest, highest;
    };
    std::optional<Extent> extent(Vec3 up) const;

  private:
    // Lower bound of the distance to the hull; 0 inside. NaN if too few other cameras see the point.
    double clear_m(std::size_t own, Vec3 point) const;
    // Calls visit(point, its clear_m) along a ray of camera `own`, within `radius_m` of the centre, until it
    // returns false.
    template <class Visit>
    void walk(std::size_t own, const Ray& ray, double radius_m, double step_m, Visit visit) const;

    const std::vector<Camera>& cameras_;
    std::vector<std::unique_ptr<SilhouetteField>> fields_;  // per camera, null: no silhouette
    int min_others_ = 1;                                    // that must see a point
    std::optional<Vec3> middle_;
};

}  // namespace kinevox
