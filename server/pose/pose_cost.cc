#include "server/pose/pose_cost.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/geometry.h"

namespace kinevox {
namespace {

Vec3 point(const float* p) {
    return {p[0], p[1], p[2]};
}

// Rest pose and its standard deviation: a weak prior for what the silhouettes do not determine.
struct Habit {
    double rest_deg, std_deg;
};
constexpr Habit kFree{0, 0};
constexpr std::array<Habit, kBodyDofCount> kHabits{{
    kFree,    kFree,    kFree,   kFree,    kFree,   kFree, kFree, {0, 15}, {0, 20},  // lumbar
    {0, 20},  {0, 15},  {0, 30},                                                     // neck
    {10, 60}, {-5, 20}, {0, 20}, {20, 60}, {0, 25},                                  // left leg
    kFree,    kFree,    kFree,   {30, 60}, {0, 25},                                  // left arm
    {10, 60}, {-5, 20}, {0, 20}, {20, 60}, {0, 25},                                  // right leg
    kFree,    kFree,    kFree,   {30, 60}, {0, 25},                                  // right arm
}};
constexpr double kLimitStd = 3 * kDegree;
constexpr double kFloorSlack_m = 0.005, kStandingStd_m = 0.01;

// The lumbar spine flexes with the hips (lumbopelvic rhythm, a review: Vazirian et al. 2016): expected
// extension = rest - share * mean hip flexion, of the joints in the studio sequences of tests/accuracy.
// Silhouettes hardly determine how the trunk's lean divides between pelvis and spine.
constexpr double kLumbarRest = -11 * kDegree, kLumbarPerHip = 0.2, kLumbarStd = 8 * kDegree;

constexpr std::array<double, 3> kInsideBalls{0.15, 0.5, 0.85};  // along each capsule, for the inside terms

bool kept_apart(int limb, int other) {
    switch (limb) {
        case kForearmL:
        case kHandL:
        case kForearmR:
        case kHandR:
            return other == kPelvis || other == kThorax || other == kHead;
        case kShankL:
        case kFootL:
            return other == kThighR || other == kShankR || other == kFootR;
        case kShankR:
        case kFootR:
            return other == kThighL || other == kShankL || other == kFootL;
        default:
            return false;
    }
}

void add_row(std::span<const int> dofs, const double* row, double residual, double weight,
             Linearisation& out) {
    for (std::size_t i = 0; i < dofs.size(); ++i) {
        const double w = weight * row[i];
        out.gradient[dofs[i]] += w * residual;
        for (std::size_t j = 0; j <= i; ++j) out.hessian(dofs[i], dofs[j]) += w * row[j];
    }
}

// Joint limits and the rest pose, on the named angles. A shoulder's angles are singular within its wide range
// of motion; only the motion prior applies there.
bool has_angle_terms(int segment) {
    return segment != kPelvis && segment != kUpperArmL && segment != kUpperArmR;
}

// Calls f(degree of freedom, residual, standard deviation), rad.
template <typename F>
void each_angle_term(int segment, const BodyCoordinates& q, const F& f) {
    const int first = kSegmentDof[segment];
    for (int k = first; k < first + kSegmentDofCount[segment]; ++k) {
        const Habit& habit = kHabits[k];
        if (habit.std_deg > 0) f(k, q[k] - habit.rest_deg * kDegree, habit.std_deg * kDegree);
        const BodyDofInfo& info = kBodyDofs[k];
        const double beyond = std::max(0.0, q[k] - info.upper) + std::min(0.0, q[k] - info.lower);
        if (beyond != 0) f(k, beyond, kLimitStd);
    }
}

void add_angle_terms(const BodyPosture& posture, const BodyCoordinates& q, Linearisation& out) {
    for (int s = 1; s < kBodySegmentCount; ++s) {
        if (!has_angle_terms(s)) continue;
        const int first = kSegmentDof[s], count = kSegmentDofCount[s];
        const Mat3 rates = count == 3 ? euler_rates(s, posture.parent_from_segment[s]) : Mat3{};
        int dofs[3];
        for (int k = 0; k < count; ++k) dofs[k] = first + k;
        each_angle_term(s, q, [&](int dof, double residual, double std) {
            const int k = dof - first;
            const double row[3] = {rates(k, 0), rates(k, 1), rates(k, 2)};
            const double weight = 1 / (std * std);
            add_row({dofs, static_cast<std::size_t>(count)}, row, residual, weight, out);
            out.cost += 0.5 * weight * residual * residual;
        });
    }
}

void add_lumbopelvic_rhythm(const BodyPosture& posture, const BodyCoordinates& q, Linearisation& out) {
    constexpr std::array<int, 3> kSegments{kThorax, kThighL, kThighR};
    constexpr std::array<double, 3> kFactors{1, kLumbarPerHip / 2, kLumbarPerHip / 2};
    std::array<int, 9> dofs{};
    std::array<double, 9> row{};
    double residual = -kLumbarRest;
    for (int n = 0; n < 3; ++n) {
        const int segment = kSegments[n], first = kSegmentDof[segment];
        const Mat3 rates = euler_rates(segment, posture.parent_from_segment[segment]);
        residual += kFactors[n] * q[first];
        for (int k = 0; k < 3; ++k) dofs[3 * n + k] = first + k, row[3 * n + k] = kFactors[n] * rates(0, k);
    }
    const double weight = 1 / (kLumbarStd * kLumbarStd);
    add_row(dofs, row.data(), residual, weight, out);
    out.cost += 0.5 * weight * residual * residual;
}

void add_prior(const MotionPrior& prior, const BodyPosture& posture, Linearisation& out) {
    const BodyStep from_expected = step_between(prior.expected, posture);
    for (int k = 0; k < kBodyDofCount; ++k) {
        if (!std::isfinite(prior.std[k])) continue;
        const double weight = 1 / (prior.std[k] * prior.std[k]);
        out.hessian(k, k) += weight;
        out.gradient[k] += weight * from_expected[k];
        out.cost += 0.5 * weight * from_expected[k] * from_expected[k];
    }
}

// Of the surface below an end of a capsule, m.
double height_of(const BodyCapsule& capsule, bool at_end) {
    return at_end ? capsule.b[2] - capsule.radius_b : capsule.a[2] - capsule.radius_a;
}

// Of Geman & McClure's kernel, r^2 / (1 + r^2 / s^2): 1 / (1 + r^2 / s^2).
double kernel_factor(double residual, double robust_m) {
    return 1 / (1 + residual * residual / (robust_m * robust_m));
}

}  // namespace

double angle_cost(const BodyPosture& posture, int segment) {
    if (!has_angle_terms(segment)) return 0;
    BodyCoordinates q;
    read_coordinates(posture, segment, q);
    double cost = 0;
    each_angle_term(segment, q, [&](int, double residual, double std) {
        cost += 0.5 * residual * residual / (std * std);
    });
    return cost;
}

StandingFoot lower_foot(std::span<const BodyCapsule> capsules) {
    StandingFoot feet[2] = {{kFootL, 0, 0}, {kFootR, 0, 0}};
    for (StandingFoot& foot : feet) {
        int ends = 0;
        for (const BodyCapsule& capsule : capsules)
            if (capsule.segment == foot.segment)
                foot.height_m += height_of(capsule, false) + height_of(capsule, true), ends += 2;
        foot.height_m /= std::max(1, ends);
    }
    StandingFoot lower = feet[0].height_m <= feet[1].height_m ? feet[0] : feet[1];
    lower.others_m = std::numeric_limits<double>::infinity();
    for (const BodyCapsule& capsule : capsules) {
        const int s = capsule.segment;
        if (s == kFootL || s == kFootR || s == kShankL || s == kShankR) continue;
        lower.others_m = std::min({lower.others_m, height_of(capsule, false), height_of(capsule, true)});
    }
    return lower;
}

double PoseCost::contour_cost(double distance_m, double robust_m) const {
    const double w = options_.term_weight / (options_.contour_std_m * options_.contour_std_m);
    return 0.5 * w * distance_m * distance_m * kernel_factor(distance_m, robust_m);
}

void PoseCost::add_term(const SurfaceTerm& term, double std_m, double robust_m, double weight) {
    const double w = weight / (std_m * std_m);
    const double factor = kernel_factor(term.residual, robust_m);
    cost_ += 0.5 * w * term.residual * term.residual * factor;
    terms_.push_back(term);
    terms_.back().weight = w * factor * factor;
}

void PoseCost::contour_terms(int camera, const SilhouetteRays& view, double robust_m) {
    nearest_.find(view.contour, capsules_);
    for (std::size_t i = 0; i < view.contour.size(); ++i) {
        if (nearest_.capsule(i) < 0) continue;
        const RayTouch touch = nearest_.touch(i);
        if (!touch.usable) continue;
        SurfaceTerm term;
        term.camera = camera;
        term.ray = static_cast<int>(i);
        term.capsule = nearest_.capsule(i);
        term.along = touch.along;
        term.point_in_world = touch.point;
        term.gradient = touch.gradient;
        term.radius_gradient = -1;
        term.residual = touch.distance;
        add_term(term, options_.contour_std_m, robust_m, options_.term_weight);
    }
}

bool PoseCost::lacks_contrast(const SilhouetteRays& view, std::size_t ball, double m_per_px) const {
    if (view.border_without_contrast.size() == 0) return false;
    const Vec2 slope = balls_.slope(ball);
    const double length = std::hypot(slope.x, slope.y);
    if (!(length > 0)) return false;
    const Vec2 centre = balls_.pixel(ball);
    const double inside_px = (balls_.radius_m(ball) - balls_.outside_m(ball)) / m_per_px;
    return view.is_nearest_to_border_without_contrast(
        {centre.x - inside_px * slope.x / length, centre.y - inside_px * slope.y / length});
}

void PoseCost::inside_terms(int camera, const SilhouetteRays& view, double robust_m) {
    const Camera& c = *view.camera;
    balls_.measure(view);
    for (std::size_t k = 0; k < capsules_.size(); ++k) {
        for (std::size_t ball = 0; ball < kInsideBalls.size(); ++ball) {
            const std::size_t n = k * kInsideBalls.size() + ball;
            const double out = balls_.outside_m(n);
            if (out <= 0) continue;
            const Vec3 in_camera = balls_.in_camera(n);
            const Vec2 slope = balls_.slope(n);
            const double m_per_px = 2 * in_camera.z / (c.fx + c.fy);
            if (lacks_contrast(view, n, m_per_px)) continue;
            // d pixel / d point, neglecting distortion and movement along the depth.
            const Vec3 in_plane{slope.x * c.fx / in_camera.z * m_per_px,
                                slope.y * c.fy / in_camera.z * m_per_px, 0};
            const Vec3 g{in_plane.x, in_plane.y,
                         -(in_plane.x * in_camera.x + in_plane.y * in_camera.y) / in_camera.z};
            SurfaceTerm term;
            term.camera = camera;
            term.capsule = static_cast<int>(k);
            term.along = kInsideBalls[ball];
            term.point_in_world = balls_.in_world(n);
            term.gradient = -(c.camera_from_world.rotation.transposed() * g);
            term.radius_gradient = 1;
            term.residual = out;
            add_term(term, options_.inside_std_m, robust_m, options_.term_weight);
        }
    }
}

// `residual`: m below a height.
void PoseCost::add_height_term(std::size_t capsule, bool at_end, double residual, double std_m,
                               double robust_m) {
    SurfaceTerm term;
    term.camera = -1;
    term.capsule = static_cast<int>(capsule);
    term.along = at_end ? 1 : 0;
    term.point_in_world = point(at_end ? capsules_[capsule].b : capsules_[capsule].a);
    term.gradient = {0, 0, -1};
    term.radius_gradient = 1;
    term.residual = residual;
    add_term(term, std_m, robust_m, 1.0);
}

void PoseCost::floor_terms() {
    for (std::size_t k = 0; k < capsules_.size(); ++k)
        for (const bool end : {false, true}) {
            const double below = -height_of(capsules_[k], end);
            if (below > kFloorSlack_m)
                add_height_term(k, end, below - kFloorSlack_m, options_.floor_std_m, 1.0);
        }
}

void PoseCost::standing_terms() {
    const int foot = lower_foot(capsules_).segment;
    for (std::size_t k = 0; k < capsules_.size(); ++k) {
        if (capsules_[k].segment != foot) continue;
        for (const bool end : {false, true})
            add_height_term(k, end, -height_of(capsules_[k], end), kStandingStd_m, options_.standing_m);
    }
}

// Forearms and hands do not penetrate the trunk, nor legs each other. Only the limb is moved; two legs each
// move the other.
void PoseCost::separation_terms(std::span<const BodyCapsule> others) {
    for (std::size_t k = 0; k < capsules_.size(); ++k) {
        const BodyCapsule& limb = capsules_[k];
        for (const BodyCapsule& other : others) {
            if (!kept_apart(limb.segment, other.segment)) continue;
            for (const double along : {0.5, 1.0}) {
                const Vec3 p = (1 - along) * point(limb.a) + along * point(limb.b);
                const Vec3 a = point(other.a), axis = point(other.b) - a;
                const double t = std::clamp(dot(p - a, axis) / (dot(axis, axis) + 1e-9), 0.0, 1.0);
                const Vec3 from_other = p - (a + t * axis);
                const double radii = (1 - along) * limb.radius_a + along * limb.radius_b +
                                     (1 - t) * other.radius_a + t * other.radius_b;
                const double distance = norm(from_other),
                             inside = options_.separation_fraction * radii - distance;
                if (inside <= 0 || distance < 1e-6) continue;
                SurfaceTerm term;
                term.camera = -1;
                term.capsule = static_cast<int>(k);
                term.along = along;
                term.point_in_world = p;
                term.gradient = -(from_other / distance);
                term.radius_gradient = 1;
                term.residual = inside;
                add_term(term, options_.separation_std_m, 1.0, 1.0);
            }
        }
    }
}

// A term's derivatives are linear in its wrench, the torque and the direction of its gradient: the wrenches
// are summed per segment, and the degrees of freedom enter once.
void PoseCost::add_surface_terms(const std::array<DofFrame, kBodyDofCount>& frames, Vec3 root_in_world,
                                 Linearisation& out) const {
    using Wrench = Eigen::Matrix<double, 6, 1>;
    struct Sums {
        double hessian[6][6] = {};  // the lower triangle
        double gradient[6] = {};
        bool any = false;
    };
    std::array<Sums, kBodySegmentCount> sums;
    for (const SurfaceTerm& term : terms_) {
        Sums& sum = sums[capsules_[term.capsule].segment];
        const Vec3 torque = cross(term.point_in_world - root_in_world, term.gradient);
        const double wrench[6] = {torque.x,        torque.y,        torque.z,
                                  term.gradient.x, term.gradient.y, term.gradient.z};
        for (int i = 0; i < 6; ++i) {
            const double w = term.weight * wrench[i];
            sum.gradient[i] += w * term.residual;
            for (int j = 0; j <= i; ++j) sum.hessian[i][j] += w * wrench[j];
        }
        sum.any = true;
    }
    std::array<Wrench, kBodyDofCount> by_dof;  // derivative by the degree of freedom = by_dof . wrench
    for (int k = 0; k < kBodyDofCount; ++k) {
        const Vec3 shift = frames[k].shift - cross(frames[k].axis, frames[k].origin - root_in_world);
        by_dof[k] << frames[k].axis.x, frames[k].axis.y, frames[k].axis.z, shift.x, shift.y, shift.z;
    }
    for (int s = 0; s < kBodySegmentCount; ++s) {
        if (!sums[s].any) continue;
        Eigen::Matrix<double, 6, 6> hessian;
        for (int i = 0; i < 6; ++i)
            for (int j = 0; j <= i; ++j) hessian(i, j) = hessian(j, i) = sums[s].hessian[i][j];
        const Eigen::Map<const Wrench> gradient(sums[s].gradient);
        const std::span<const int> dofs = dofs_of_segment(s);
        for (std::size_t i = 0; i < dofs.size(); ++i) {
            const Wrench column = hessian * by_dof[dofs[i]];
            out.gradient[dofs[i]] += by_dof[dofs[i]].dot(gradient);
            for (std::size_t j = 0; j <= i; ++j) out.hessian(dofs[i], dofs[j]) += by_dof[dofs[j]].dot(column);
        }
    }
}

void PoseCost::find_terms(const BodyModel& model, const BodyPosture& posture,
                          std::span<const SilhouetteRays> views, double robust_m) {
    posed_ = model.forward(posture);
    model.capsules(posed_, capsules_);
    terms_.clear();
    cost_ = 0;
    balls_.place(capsules_, kInsideBalls);
    for (std::size_t c = 0; c < views.size(); ++c) {
        if (!views[c].camera) continue;
        contour_terms(static_cast<int>(c), views[c], robust_m);
        inside_terms(static_cast<int>(c), views[c], robust_m);
    }
    floor_terms();
    if (options_.standing_m > 0) standing_terms();
    separation_terms(capsules_);
}

double PoseCost::cost_beside(std::span<const BodyCapsule> moving, std::span<const BodyCapsule> rest,
                             std::span<const SilhouetteRays> views, double robust_m) {
    capsules_.assign(moving.begin(), moving.end());
    terms_.clear();
    cost_ = 0;
    balls_.place(capsules_, kInsideBalls);
    for (std::size_t c = 0; c < views.size(); ++c)
        if (views[c].camera) inside_terms(static_cast<int>(c), views[c], robust_m);
    floor_terms();
    separation_terms(rest);
    return cost_;
}

double PoseCost::cost_of(const BodyModel& model, const BodyPosture& posture,
                         std::span<const SilhouetteRays> views, double robust_m) {
    find_terms(model, posture, views, robust_m);
    angles_ = {};
    const BodyCoordinates q = coordinates_from_posture(posture);
    add_angle_terms(posture, q, angles_);
    add_lumbopelvic_rhythm(posture, q, angles_);
    return cost_ + angles_.cost;
}

void PoseCost::linearise(const BodyModel& model, const BodyPosture& posture,
                         std::span<const SilhouetteRays> views, const MotionPrior* prior, double robust_m,
                         Linearisation& out) {
    find_terms(model, posture, views, robust_m);
    out.hessian.setZero();
    out.gradient.setZero();
    out.cost = cost_;
    add_surface_terms(model.dof_frames(posed_), posture.root_in_world, out);
    const BodyCoordinates q = coordinates_from_posture(posture);
    add_angle_terms(posture, q, out);
    add_lumbopelvic_rhythm(posture, q, out);
    if (prior) add_prior(*prior, posture, out);
    out.hessian.triangularView<Eigen::StrictlyUpper>() = out.hessian.transpose();
}

}  // namespace kinevox
