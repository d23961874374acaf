// The cost of a posed body against the silhouettes, linearised for the fit.
//
// Contour term: a ray through a silhouette's border touches the body, so the signed distance from the ray to
// the nearest capsule is zero. Inside term: no part of the body projects outside a silhouette.
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/capsule_balls.h"
#include "server/pose/pose_options.h"
#include "server/pose/ray_capsule.h"
#include "server/pose/silhouette_rays.h"

namespace kinevox {

// One residual and its derivatives by the surface point of the body that causes it.
struct SurfaceTerm {
    int camera = 0;  // -1: of none
    int ray = -1;    // of the camera's contour; -1: not a contour term
    int capsule = 0;
    double along = 0;            // from a (0) to b (1)
    Vec3 point_in_world;         // on the capsule's axis
    Vec3 gradient;               // d residual / d point
    double radius_gradient = 0;  // d residual / d radius at the point
    double residual = 0;         // m
    double weight = 0;           // 1/m^2, the robust factor included
};

struct Linearisation {
    using Hessian = Eigen::Matrix<double, kBodyDofCount, kBodyDofCount>;
    using Gradient = Eigen::Matrix<double, kBodyDofCount, 1>;
    Hessian hessian = Hessian::Zero();     // J^T W J, full
    Gradient gradient = Gradient::Zero();  // J^T W r
    double cost = 0;
};

// The prior of a fit: where the body is expected.
struct MotionPrior {
    BodyPosture expected;
    BodyStep std{};  // infinite: no prior for this degree of freedom
};

// The lower foot and the height of its sole above the floor; `others_m`: of the lowest part but feet and
// shanks.
struct StandingFoot {
    int segment = 0;
    double height_m = 0, others_m = 0;
};
StandingFoot lower_foot(std::span<const BodyCapsule> capsules);

// The part of PoseCost::cost_of() that depends on the angles of one segment's joint alone: limits and habits.
double angle_cost(const BodyPosture& posture, int segment);

class PoseCost {
  public:
    explicit PoseCost(const PoseCostOptions& options = {}) : options_(options) {}

    // `robust_m`: scale of the robust kernel; much larger distances hardly count. `prior` may be null. Fills
    // terms().
    void linearise(const BodyModel& model, const BodyPosture& posture, std::span<const SilhouetteRays> views,
                   const MotionPrior* prior, double robust_m, Linearisation& out);
    // Only the cost, without prior.
    double cost_of(const BodyModel& model, const BodyPosture& posture, std::span<const SilhouetteRays> views,
                   double robust_m);
    // What capsules cost that move before an unmoved rest of the body, without contours and angles. Fills
    // terms() with theirs.
    double cost_beside(std::span<const BodyCapsule> moving, std::span<const BodyCapsule> rest,
                       std::span<const SilhouetteRays> views, double robust_m);
    // Of a contour's ray at this distance from the body.
    double contour_cost(double distance_m, double robust_m) const;
    double standing_m() const { return options_.standing_m; }
    const PoseCostOptions& options() const { return options_; }
    void set_standing(double standing_m) { options_.standing_m = standing_m; }
    const std::vector<SurfaceTerm>& terms() const { return terms_; }
    const PosedBody& posed() const { return posed_; }
    const std::vector<BodyCapsule>& capsules() const { return capsules_; }

  private:
    void find_terms(const BodyModel& model, const BodyPosture& posture, std::span<const SilhouetteRays> views,
                    double robust_m);
    void contour_terms(int camera, const SilhouetteRays& view, double robust_m);
    // Whether what the ball is outside of is a border without contrast.
    bool lacks_contrast(const SilhouetteRays& view, std::size_t ball, double m_per_px) const;
    void inside_terms(int camera, const SilhouetteRays& view, double robust_m);
    void floor_terms();
    void standing_terms();
    void add_height_term(std::size_t capsule, bool at_end, double residual, double std_m, double robust_m);
    void separation_terms(std::span<const BodyCapsule> others);
    void add_term(const SurfaceTerm& term, double std_m, double robust_m, double weight);
    void add_surface_terms(const std::array<DofFrame, kBodyDofCount>& frames, Vec3 root_in_world,
                           Linearisation& out) const;

    PoseCostOptions options_;
    PosedBody posed_;
    std::vector<BodyCapsule> capsules_;
    std::vector<SurfaceTerm> terms_;
    double cost_ = 0;
    Linearisation angles_;  // of cost_of()
    CapsuleBalls balls_;    // kInsideBalls.size() per capsule
    NearestCapsules nearest_;
};

}  // namespace kinevox
