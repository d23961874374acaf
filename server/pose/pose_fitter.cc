#include "server/pose/pose_fitter.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

namespace kinevox {
namespace {

using Vector = Eigen::Matrix<double, kBodyDofCount, 1>;
using Matrix = Eigen::Matrix<double, kBodyDofCount, kBodyDofCount>;

constexpr double kFirstDamping = 1e-3, kMinDamping = 1e-6, kMaxDamping = 1e6;
constexpr double kMaxRotation =
    0.5;  // rad per step and degree of freedom: the linearisation is valid up to here
// Added to the diagonal in addition to the damping: keeps undetermined parameters (1/m^2 and 1/rad^2).
constexpr double kFloor = 1e-2;

}  // namespace

std::string PoseFitOptions::check() const {
    if (!(narrow_m > 0) || !(wide_m >= narrow_m))
        return fmt::format(
            "pose fit: wide_m {} and narrow_m {}; both must be positive, the wide one not smaller", wide_m,
            narrow_m);
    if (wide_steps < 0 || narrow_steps < 1)
        return fmt::format("pose fit: {} wide and {} narrow steps; at least 0 and 1", wide_steps,
                           narrow_steps);
    if (!(cost.contour_std_m > 0) || !(cost.inside_std_m > 0) || !(cost.floor_std_m > 0) ||
        !(cost.term_weight > 0))
        return "pose fit: standard deviations and weights of the cost must be positive";
    return {};
}

ContourFit contour_fit(std::span<const SurfaceTerm> terms, double narrow_m) {
    ContourFit fit;
    double sum = 0;
    int within = 0, camera = -1, far = 0;  // terms are in the order of the cameras
    for (const SurfaceTerm& term : terms) {
        if (term.ray < 0) continue;
        const double r = std::abs(term.residual);
        if (std::exchange(camera, term.camera) != term.camera) far = 0;
        if (r > 2 * narrow_m) fit.far = std::max(fit.far, ++far);
        if (r < 3 * narrow_m) sum += r * r, ++within;
        if (r < narrow_m) ++fit.touching;
    }
    fit.rms_m = within > 0 ? std::sqrt(sum / within) : 0;
    return fit;
}

MotionPrior motion_prior(const BodyPosture& expected, double time2, const PoseTrackerOptions& options) {
    MotionPrior prior;
    prior.expected = expected;
    for (int k = 0; k < kBodyDofCount; ++k)
        prior.std[k] = k < 3   ? 0.005 + options.root_acceleration_m_per_s2 * time2
                       : k < 6 ? 0.02 + options.root_angular_acceleration_rad_per_s2 * time2
                               : 0.03 + options.joint_angular_acceleration_rad_per_s2 * time2;
    return prior;
}

void PoseFitter::descend(const BodyModel& model, std::span<const SilhouetteRays> views,
                         const MotionPrior* prior, double robust_m, int steps, PoseFit& fit) {
    cost_.linearise(model, fit.posture, views, prior, robust_m, fit.at);
    double damping = kFirstDamping;
    for (int k = 0; k < steps; ++k) {
        Matrix damped = fit.at.hessian;
        damped.diagonal() += damping * fit.at.hessian.diagonal();
        damped.diagonal().array() += kFloor;
        Vector step = damped.ldlt().solve(-fit.at.gradient);
        if (!step.allFinite()) return;
        const double largest = step.tail<kBodyDofCount - 3>().cwiseAbs().maxCoeff();
        if (largest > kMaxRotation) step *= kMaxRotation / largest;
        const BodyPosture next =
            stepped(fit.posture, std::span<const double, kBodyDofCount>(step.data(), kBodyDofCount));
        cost_.linearise(model, next, views, prior, robust_m, trial_);
        if (trial_.cost < fit.at.cost) {
            const double gained = (fit.at.cost - trial_.cost) / fit.at.cost;
            fit.posture = next;
            std::swap(fit.at, trial_);
            damping = std::max(kMinDamping, damping / 5);
            if (gained < options_.done_below) return;
        } else {
            damping *= 8;
            if (damping > kMaxDamping) return;
        }
    }
}

PoseFit PoseFitter::approach(const BodyModel& model, std::span<const SilhouetteRays> views,
                             const BodyPosture& start, const MotionPrior* prior) {
    PoseFit fit;
    fit.posture = start;
    descend(model, views, prior, options_.wide_m, options_.wide_steps, fit);
    return fit;
}

PoseFit PoseFitter::fit(const BodyModel& model, std::span<const SilhouetteRays> views,
                        const BodyPosture& start, const MotionPrior* prior, bool wide) {
    PoseFit fit;
    fit.posture = wide ? approach(model, views, start, prior).posture : start;
    descend(model, views, prior, options_.narrow_m, options_.narrow_steps, fit);
    // The terms are those of the last step tried; at the solution they are nearly the same.
    int rays = 0;
    for (const SilhouetteRays& view : views)
        if (view.camera) rays += static_cast<int>(view.contour.size());
    const ContourFit contour = contour_fit(cost_.terms(), options_.narrow_m);
    fit.contour_residual_rms_m = contour.rms_m;
    fit.unexplained = contour.far;
    fit.explained = rays > 0 ? static_cast<double>(contour.touching) / rays : 0;
    return fit;
}

double PoseFitter::cost_of(const BodyModel& model, std::span<const SilhouetteRays> views,
                           const BodyPosture& posture) {
    return cost_.cost_of(model, posture, views, options_.wide_m);
}

}  // namespace kinevox
