#include "server/calibration/person/silhouette_hull.h"

#include <algorithm>
#include <cmath>

#include "server/calibration/triangulation.h"

namespace kinevox {
namespace {

constexpr double kInsidePx = 0.5;    // the distance field is smoothed at corners by about this much
constexpr int kContourPoints = 400;  // per silhouette, for the extent
constexpr double kRadius_m = 1.6, kStep_m = 0.008, kNearest_m = 0.3;

}  // namespace

SilhouetteHull::SilhouetteHull(const std::vector<Camera>& cameras, const std::vector<SilhouetteMask>& images)
    : cameras_(cameras), fields_(cameras.size()) {
    std::vector<Observation> observations;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        if (images[c].empty()) continue;
        auto field = std::make_unique<SilhouetteField>(images[c].mask, cameras[c].width, cameras[c].height);
        if (field->empty()) continue;
        observations.push_back(
            {&cameras[c], {0.5 * (field->left + field->right), 0.5 * (field->top + field->bottom)}});
        fields_[c] = std::move(field);
    }
    // A region that only two of many cameras see is no hull: outside the other images the cones of two
    // opposite cameras intersect in a long ghost.
    if (observations.size() >= 4) min_others_ = 2;
    if (observations.size() >= 2) middle_ = triangulate(observations);
}

double SilhouetteHull::clear_m(std::size_t own, Vec3 point) const {
    double clear = 0;
    int votes = 0;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (c == own || !fields_[c]) continue;
        const auto pixel = cameras_[c].project(point);
        if (!pixel) continue;
        const double inside =
            fields_[c]->distance(static_cast<float>(pixel->x), static_cast<float>(pixel->y));
        if (std::isnan(inside)) continue;
        ++votes;
        if (inside < -kInsidePx)
            clear = std::max(clear, (-inside - kInsidePx) * (cameras_[c].camera_from_world * point).z /
                                        std::max(cameras_[c].fx, cameras_[c].fy));
    }
    return votes >= min_others_ ? clear : std::nan("");
}

template <class Visit>
void SilhouetteHull::walk(std::size_t own, const Ray& ray, double radius_m, double step_m,
                          Visit visit) const {
    const double centre = dot(*middle_ - ray.origin_in_world, ray.direction_in_world);
    for (double depth = std::max(kNearest_m, centre - radius_m); depth < centre + radius_m;) {
        const Vec3 point = ray.origin_in_world + depth * ray.direction_in_world;
        const double clear = clear_m(own, point);
        if (!visit(point, clear)) return;
        // Less than the clearance: perspective and distortion change the scale.
        depth += std::isnan(clear) ? step_m : std::max(step_m, 0.6 * clear);
    }
}

SilhouetteHull::Meets SilhouetteHull::meets(std::size_t own, const Ray& ray, double radius_m,
                                            double step_m) const {
    Meets answer = Meets::kUnseen;
    walk(own, ray, radius_m, step_m, [&](Vec3, double clear) {
        if (!std::isnan(clear)) answer = clear == 0 ? Meets::kYes : Meets::kNo;
        return answer != Meets::kYes;
    });
    return answer;
}

std::optional<SilhouetteHull::Extent> SilhouetteHull::extent(Vec3 up) const {
    std::optional<Extent> extent;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (!fields_[c]) continue;
        for (const Vec2 pixel : fields_[c]->contour(kContourPoints))
            walk(c, cameras_[c].ray_through(pixel), kRadius_m, kStep_m, [&](Vec3 point, double clear) {
                if (clear != 0) return true;  // also for NaN
                if (!extent) extent = Extent{point, point};
                if (dot(point - extent->lowest, up) < 0) extent->lowest = point;
                if (dot(point - extent->highest, up) > 0) extent->highest = point;
                return true;
            });
    }
    return extent;
}

}  // namespace kinevox
