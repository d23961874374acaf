// Levenberg-Marquardt over the 32 degrees of freedom of one frame set.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/pose_cost.h"
#include "server/pose/pose_options.h"

namespace kinevox {

struct PoseFit {
    BodyPosture posture;
    Linearisation at;                   // at the solution, with narrow_m
    double contour_residual_rms_m = 0;  // of the contour rays within 3 * narrow_m
    double explained = 0;               // fraction of the contour rays within narrow_m of the body, 0..1
    int unexplained = 0;                // of a camera's contour rays, number far from the body; the largest
};

// How well the contour rays of a linearisation fit.
struct ContourFit {
    double rms_m = 0;  // of those within 3 * narrow_m
    int touching = 0;  // number within narrow_m
    int far = 0;       // number beyond 2 * narrow_m, of the camera with most of them
};
ContourFit contour_fit(std::span<const SurfaceTerm> terms, double narrow_m);

// What accelerations leave open around an expected posture: they move the body by themselves times `time2`,
// s^2.
MotionPrior motion_prior(const BodyPosture& expected, double time2, const PoseTrackerOptions& options);

// No joint is farther from a known posture after approach(): the fit would end in that one.
inline constexpr double kKnownJoints_m = 0.02;

// In a recording, limits of the cost with the wide kernel beyond which another start is given up: of
// exchanged limbs, and of any start after approach(). `known`: that of the known posture. In three sequences,
// of the starts that became the better fit none had more than 2.3 and 1.3 times the known one.
inline double max_exchanged_cost(double known) {
    return 500 + 2.5 * known;
}
inline double max_approached_cost(double known) {
    return 100 + 1.5 * known;
}

// Not thread safe; keeps its memory.
class PoseFitter {
  public:
    explicit PoseFitter(const PoseFitOptions& options = {}) : options_(options), cost_(options.cost) {}

    // The steps with the wide kernel, of which `at` is. `prior` may be null.
    PoseFit approach(const BodyModel& model, std::span<const SilhouetteRays> views, const BodyPosture& start,
                     const MotionPrior* prior);

    // `prior` may be null. `wide`: starts with approach().
    PoseFit fit(const BodyModel& model, std::span<const SilhouetteRays> views, const BodyPosture& start,
                const MotionPrior* prior, bool wide);

    // Only the cost, for comparing initial postures.
    double cost_of(const BodyModel& model, std::span<const SilhouetteRays> views, const BodyPosture& posture);

    const PoseCost& cost() const { return cost_; }
    void set_standing(double standing_m) { cost_.set_standing(standing_m); }

  private:
    void descend(const BodyModel& model, std::span<const SilhouetteRays> views, const MotionPrior* prior,
                 double robust_m, int steps, PoseFit& fit);

    PoseFitOptions options_;
    PoseCost cost_;
    Linearisation trial_;
};

}  // namespace kinevox
