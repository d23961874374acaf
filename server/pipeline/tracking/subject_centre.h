// The subject's centre: G, the point nearest to the viewing rays of all silhouettes (paper 3.2), robust
// against a camera whose silhouette shows another object or whose calibration is wrong; and the filter of G
// over time.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "common/camera.h"
#include "common/geometry.h"

namespace kinevox {

// A blob of one camera that may be the subject.
struct RayCandidate {
    int camera = 0;
    Ray ray;                      // through the centre of gravity of its silhouette
    double area_px = 0;           // of its silhouette
    double metres_per_pixel = 0;  // at 1 m from the camera: 1 / focal length
    // The image border cuts the silhouette, so its centre is biased: the ray has a low weight and a larger
    // tolerance.
    bool truncated = false;
};

struct RayIntersectionOptions {
    double tolerance_m = 0.25;           // distance from G beyond which a ray is an outlier
    double truncated_tolerance_m = 0.8;  // the same for a truncated silhouette
    double ray_std_m = 0.04;        // distance between the rays of good silhouettes of one body; the weight
                                    // of larger distances decreases (Cauchy)
    double subject_area_m2 = 0.35;  // silhouettes of this area and larger have the full weight
    double min_area_m2 = 0.02;      // smaller ones are no person
    double max_area_m2 = 4.0;       // nor are larger ones
    bool operator==(const RayIntersectionOptions&) const = default;
};

struct RayIntersection {
    Vec3 point_in_world;  // G, m
    Mat3 covariance_m2;
    double score = 0;         // grows with the number, the size and the consistency of the silhouettes
    std::vector<int> chosen;  // per camera: the index of the inlier candidate, -1 for none
    int inlier_count = 0;     // cameras, at least 2
};

// Every pair of rays of two cameras proposes a point, the candidates near it vote, and the best point is
// refined over its inliers. Candidates in any order; cameras are 0 .. camera_count - 1. With `prior`, only
// points within `prior_radius_m` of it are considered. Empty without two consistent rays. Ties are resolved
// in a fixed order.
std::optional<RayIntersection> intersect_rays(const std::vector<RayCandidate>& candidates, int camera_count,
                                              const RayIntersectionOptions& options = {},
                                              const Vec3* prior = nullptr, double prior_radius_m = 0);

double distance_to_ray(const Ray& ray, Vec3 point_in_world);

struct CentreFilterOptions {
    double acceleration_std_m_per_s2 = 6;  // of people: about that of a sprinter's push-off
    double initial_speed_std_m_per_s = 2;  // of a new subject
    bool operator==(const CentreFilterOptions&) const = default;
};

// Kalman filter of the subject's centre: constant velocity with white acceleration noise.
class CentreFilter {
  public:
    explicit CentreFilter(const CentreFilterOptions& options = {}) : options_(options) {}

    // Starts at a measured centre, at rest. `covariance_m2` is the measurement's.
    void start(Vec3 centre_in_world, const Mat3& covariance_m2);
    // Predicts the state after `seconds` >= 0.
    void predict(double seconds);
    void correct(Vec3 centre_in_world, const Mat3& covariance_m2);

    Vec3 centre_in_world() const;    // m
    Vec3 velocity_in_world() const;  // m/s
    double centre_std_m() const;     // one axis, root mean square of the three

  private:
    CentreFilterOptions options_;
    std::array<double, 6> state_{};        // position, velocity
    std::array<double, 36> covariance_{};  // row major
};

}  // namespace kinevox
