#include "server/calibration/silhouette_hull.h"

#include <algorithm>
#include <cmath>

#include "server/calibration/triangulation.h"

namespace kinevox {
namespace {

constexpr double kInsidePx = 0.5;    // a field of distances is smooth at corners by about as much
constexpr int kOutlinePoints = 400;  // per silhouette, for the extent
constexpr double kReach_m = 1.6, kStep_m = 0.008, kNearest_m = 0.3;

}  // namespace

SilhouetteHull::SilhouetteHull(const std::vector<Camera>& cameras,
                               const std::vector<SilhouettePicture>& pictures)
    : cameras_(cameras), fields_(cameras.size()) {
    std::vector<Sight> sights;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        if (pictures[c].empty()) continue;
        auto field = std::make_unique<SilhouetteField>(pictures[c].mask, cameras[c].width, cameras[c].height);
        if (field->empty()) continue;
        sights.push_back(
            {&cameras[c], {0.5 * (field->left + field->right), 0.5 * (field->top + field->bottom)}});
        fields_[c] = std::move(field);
    }
    // What only two of many cameras see is no hull: behind the border of the other pictures the cones of two
    // that face each other meet in a long ghost.
    if (sights.size() >= 4) min_others_ = 2;
    if (sights.size() >= 2) middle_ = triangulate(sights);
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
void SilhouetteHull::walk(std::size_t own, const Ray& ray, double reach_m, double step_m, Visit visit) const {
    const double centre = dot(*middle_ - ray.origin_in_world, ray.direction_in_world);
    for (double depth = std::max(kNearest_m, centre - reach_m); depth < centre + reach_m;) {
        const Vec3 place = ray.origin_in_world + depth * ray.direction_in_world;
        const double clear = clear_m(own, place);
        if (!visit(place, clear)) return;
        // Less than what is clear: perspective and distortion bend the scale.
        depth += std::isnan(clear) ? step_m : std::max(step_m, 0.6 * clear);
    }
}

SilhouetteHull::Meets SilhouetteHull::meets(std::size_t own, const Ray& ray, double reach_m,
                                            double step_m) const {
    Meets answer = Meets::kUnseen;
    walk(own, ray, reach_m, step_m, [&](Vec3, double clear) {
        if (!std::isnan(clear)) answer = clear == 0 ? Meets::kYes : Meets::kNo;
        return answer != Meets::kYes;
    });
    return answer;
}

std::optional<SilhouetteHull::Extent> SilhouetteHull::extent(Vec3 up) const {
    std::optional<Extent> extent;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (!fields_[c]) continue;
        for (const Vec2 pixel : fields_[c]->outline(kOutlinePoints))
            walk(c, cameras_[c].ray_through(pixel), kReach_m, kStep_m, [&](Vec3 place, double clear) {
                if (clear != 0) return true;  // NaN neither
                if (!extent) extent = Extent{place, place};
                if (dot(place - extent->lowest, up) < 0) extent->lowest = place;
                if (dot(place - extent->highest, up) > 0) extent->highest = place;
                return true;
            });
    }
    return extent;
}

}  // namespace kinevox
