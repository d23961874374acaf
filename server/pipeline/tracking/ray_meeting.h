// G, the point nearest to the viewing rays of all silhouettes (paper 3.2), robust against a camera whose
// silhouette is another thing or whose calibration is wrong.
#pragma once

#include <optional>
#include <vector>

#include "common/camera.h"
#include "common/geometry.h"

namespace kinevox {

// One thing that a camera sees and that may be the subject.
struct RayCandidate {
    int camera = 0;
    Ray ray;                      // through the centre of gravity of its silhouette
    double area_px = 0;           // of its silhouette
    double metres_per_pixel = 0;  // at 1 m from the camera: 1 / focal length
    // The silhouette is cut by the picture's border: its centre is that of a part, so the ray counts little
    // and is allowed to be further off.
    bool partial = false;
};

struct MeetingOptions {
    double tolerance_m = 0.25;         // a ray that passes G further off disagrees
    double partial_tolerance_m = 0.8;  // the same for a partial silhouette
    double ray_std_m = 0.04;        // how far the rays of good silhouettes of one body miss each other; rays
                                    // that miss by much more count less and less (Cauchy)
    double subject_area_m2 = 0.35;  // silhouettes of this area and larger count in full as the subject
    double min_area_m2 = 0.02;      // smaller ones are not a person
    double max_area_m2 = 4.0;       // larger ones neither
};

struct Meeting {
    Vec3 point_in_world;  // G, m
    Mat3 covariance_m2;
    double score = 0;         // grows with the number, the size and the agreement of the silhouettes
    std::vector<int> chosen;  // per camera: the candidate that agrees (an index), -1 if none does
    int agreeing = 0;         // cameras; at least 2
};

// Every pair of rays of two cameras proposes a point, the candidates that pass it vote, the best point is
// refined over them. Candidates in any order; cameras are 0 .. camera_count - 1. With `prior`, only points
// within `prior_radius_m` of it are considered. Nothing if no two rays agree. The order of ties is fixed.
std::optional<Meeting> meet_rays(const std::vector<RayCandidate>& candidates, int camera_count,
                                 const MeetingOptions& options = {}, const Vec3* prior = nullptr,
                                 double prior_radius_m = 0);

double distance_to_ray(const Ray& ray, Vec3 point_in_world);

}  // namespace kinevox
