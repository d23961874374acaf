// The visual hull of one moment, exactly, without voxels: asked place by place from the silhouettes.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/calibration/silhouette_field.h"
#include "server/calibration/silhouette_set.h"

namespace kinevox {

class SilhouetteHull {
  public:
    // `cameras` must outlive it. Cameras with an empty picture do not count.
    SilhouetteHull(const std::vector<Camera>& cameras, const std::vector<SilhouettePicture>& pictures);

    // Whether two silhouettes or more meet somewhere; nothing else may be called otherwise.
    bool usable() const { return middle_.has_value(); }
    Vec3 middle() const { return *middle_; }  // of the subject, m, roughly
    const SilhouetteField* field(std::size_t camera) const { return fields_[camera].get(); }

    enum class Meets { kYes, kNo, kUnseen };
    // Whether the ray through a pixel of camera `own` meets all other silhouettes at one place, within
    // `reach_m` of the middle; kUnseen where it passes no place that enough of them see.
    Meets meets(std::size_t own, const Ray& ray, double reach_m, double step_m) const;

    // The hull's lowest and highest point along `up` (world, length 1), on rays through the outlines, m;
    // nothing where the hull is empty. A hull reaches a little below feet and above a head: under soles that
    // are `w` wide by about w / 2 times the tangent of the angle by which the cameras look down.
    struct Extent {
        Vec3 lowest, highest;
    };
    std::optional<Extent> extent(Vec3 up) const;

  private:
    // By how much a place is at least away from the hull; 0 within it. NaN where too few other cameras see
    // it.
    double clear_m(std::size_t own, Vec3 point) const;
    // visit(place, clear_m of it) along a ray of camera `own`, within `reach_m` of the middle, until it
    // returns false.
    template <class Visit>
    void walk(std::size_t own, const Ray& ray, double reach_m, double step_m, Visit visit) const;

    const std::vector<Camera>& cameras_;
    std::vector<std::unique_ptr<SilhouetteField>> fields_;  // per camera, null: no silhouette
    int min_others_ = 1;                                    // that must see a place
    std::optional<Vec3> middle_;
};

}  // namespace kinevox
