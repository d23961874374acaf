#include "server/pose/joint_fit.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/geometry.h"
#include "common/to_eigen.h"
#include "server/pose/pose_fitter.h"

namespace kinevox {
namespace {

// Another start of the fit, hair relative to the stature: from little hair, the head may tilt back instead.
constexpr double kLongHair = 0.035, kHeadForwards_rad = 15 * kDegree;
constexpr double kStandingFit_m = 0.15;  // robust kernel of standing: wider than that of the poses

using PoseVector = Eigen::Matrix<double, kBodyDofCount, 1>;

}  // namespace

JointFit::ShapeRates::ShapeRates(const BodyShape& shape) {
    constexpr double kStep_m = 0.125;
    const BodyModel base(shape);
    capsules.resize(base.capsules_in_segments().size());
    for (auto& offset : offsets) offset.setZero();
    for (Capsule& c : capsules) c.a.setZero(), c.b.setZero(), c.radius_a.setZero(), c.radius_b.setZero();
    for (int k = 0; k < kBodyLengthCount; ++k) {
        BodyShape longer = shape;
        longer.lengths_m[k] += kStep_m;
        const BodyModel model(longer);
        for (int s = 0; s < kBodySegmentCount; ++s)
            offsets[s].col(k) = to_eigen((model.offset_in_parent(s) - base.offset_in_parent(s)) / kStep_m);
        for (std::size_t n = 0; n < capsules.size(); ++n) {
            const BodyCapsule &p = base.capsules_in_segments()[n], &q = model.capsules_in_segments()[n];
            for (int axis = 0; axis < 3; ++axis) {
                capsules[n].a(axis, k) = (q.a[axis] - p.a[axis]) / kStep_m;
                capsules[n].b(axis, k) = (q.b[axis] - p.b[axis]) / kStep_m;
            }
            capsules[n].radius_a(k) = (q.radius_a - p.radius_a) / kStep_m;
            capsules[n].radius_b(k) = (q.radius_b - p.radius_b) / kStep_m;
        }
    }
}

JointFit::JointFit(std::vector<const PoseObservation*> frames, std::vector<BodyPosture> postures,
                   const BodyShape& shape, const PoseStageOptions& posing, const BodyFitOptions& options,
                   std::stop_token stop)
    : frames_(std::move(frames)),
      postures_(std::move(postures)),
      shape_(shape),
      options_(options),
      stop_(std::move(stop)),
      rates_(shape),
      prior_(options.stature_std_m, options.stature_m),
      costs_(frames_.size(), PoseCost(posing.tracker.fit.cost)),
      systems_(frames_.size()) {}

double JointFit::descend(double robust_m, int steps, double independent) {
    robust_m_ = robust_m;
    share_ = std::min(1.0, independent / static_cast<double>(frames_.size()));
    double cost = linearise(shape_, postures_), damping = 1e-3;
    for (int k = 0; k < steps && !stop_.stop_requested(); ++k) {
        BodyShape shape = shape_;
        std::vector<BodyPosture> postures = postures_;
        step(damping, shape, postures);
        const double trial = linearise(shape, postures);
        if (trial < cost) {
            const double gained = (cost - trial) / cost;
            cost = trial, shape_ = shape, postures_ = postures;
            damping = std::max(1e-5, damping / 5);
            if (gained < 1e-4) return cost;
        } else {
            damping *= 8;
            if (damping > 1e4) return cost;
            linearise(shape_, postures_);
        }
    }
    return cost;
}

void JointFit::grow_hair() {
    shape_[kHairBack] = kLongHair * shape_.stature_m;
    const Mat3 forwards = rotation_y(kHeadForwards_rad);
    for (BodyPosture& posture : postures_)
        posture.parent_from_segment[kHead] = posture.parent_from_segment[kHead] * forwards;
}

void JointFit::set_standing(std::size_t n) {
    costs_[n].set_standing(kStandingFit_m);
}

double JointFit::prior_cost(const BodyShape& shape) const {
    BodyMatrix hessian = BodyMatrix::Zero();
    BodyVector gradient = BodyVector::Zero();
    return prior_.add(shape, hessian, gradient);
}

std::vector<double> JointFit::explained_fractions(double narrow_m) const {
    std::vector<double> fractions;
    for (std::size_t n = 0; n < frames_.size(); ++n) {
        std::size_t rays = 0;
        for (const SilhouetteRays& view : frames_[n]->views)
            if (view.camera) rays += view.contour.size();
        const int touching = contour_fit(costs_[n].terms(), narrow_m).touching;
        fractions.push_back(rays > 0 ? touching / static_cast<double>(rays) : 0);
    }
    return fractions;
}

std::array<double, kBodyParameters> JointFit::std_m() {
    eliminate(0);
    const BodyMatrix covariance = reduced_hessian().ldlt().solve(BodyMatrix::Identity());
    std::array<double, kBodyParameters> std;
    for (int k = 0; k < kBodyParameters; ++k) std[k] = std::sqrt(std::max(0.0, covariance(k, k)));
    return std;
}

double JointFit::rms_m() const {
    double sum = 0;
    std::size_t count = 0;
    for (const PoseCost& cost : costs_)
        for (const SurfaceTerm& term : cost.terms())
            if (term.radius_gradient < 0 && std::abs(term.residual) < 3 * robust_m_)
                sum += term.residual * term.residual, ++count;
    return count > 0 ? std::sqrt(sum / static_cast<double>(count)) : 0;
}

double JointFit::linearise(const BodyShape& shape, const std::vector<BodyPosture>& postures) {
    const BodyModel model(shape);
    oneapi::tbb::parallel_for(std::size_t{0}, frames_.size(), [&](std::size_t n) {
        costs_[n].linearise(model, postures[n], frames_[n]->views, nullptr, robust_m_, systems_[n].pose);
        add_shape(model, costs_[n], systems_[n]);
    });
    usual_.setZero();
    usual_gradient_.setZero();
    double cost = prior_.add(shape, usual_, usual_gradient_);
    for (const FrameSystem& system : systems_) cost += share_ * system.pose.cost;
    return cost;
}

void JointFit::eliminate(double damping) {
    oneapi::tbb::parallel_for(std::size_t{0}, frames_.size(), [&](std::size_t n) {
        PoseMatrix damped = systems_[n].pose.hessian;
        damped.diagonal() += damping * systems_[n].pose.hessian.diagonal();
        damped.diagonal().array() += 1;
        systems_[n].factor.compute(damped);
    });
}

BodyMatrix JointFit::reduced_hessian() const {
    BodyMatrix hessian = usual_;
    for (const FrameSystem& s : systems_)
        hessian += share_ * (s.shape - s.mixed.transpose() * s.factor.solve(s.mixed));
    return hessian;
}

void JointFit::step(double damping, BodyShape& shape, std::vector<BodyPosture>& postures) {
    eliminate(damping);
    BodyMatrix hessian = reduced_hessian();
    BodyVector gradient = usual_gradient_;
    for (const FrameSystem& s : systems_)
        gradient += share_ * (s.shape_gradient - s.mixed.transpose() * s.factor.solve(s.pose.gradient));
    hessian.diagonal() *= 1 + damping;
    const BodyVector change = hessian.ldlt().solve(-gradient);
    for (int k = 0; k < kBodyLengthCount; ++k)
        shape.lengths_m[k] = std::max(0.004, shape.lengths_m[k] + change(k));
    shape.stature_m = std::clamp(shape.stature_m + change(kStatureParameter), 0.6, 2.4);
    for (std::size_t n = 0; n < postures.size(); ++n) {
        PoseVector d = systems_[n].factor.solve(-(systems_[n].pose.gradient + systems_[n].mixed * change));
        const double largest = d.tail<kBodyDofCount - 3>().cwiseAbs().maxCoeff();
        if (largest > 0.4) d *= 0.4 / largest;
        postures[n] = stepped(postures[n], std::span<const double, kBodyDofCount>(d.data(), kBodyDofCount));
    }
}

void JointFit::add_shape(const BodyModel& model, const PoseCost& cost, FrameSystem& system) const {
    const PosedBody& posed = cost.posed();
    std::array<PointByShape, kBodySegmentCount> origin_rates;
    origin_rates[kPelvis].setZero();
    for (int s = 1; s < kBodySegmentCount; ++s) {
        const Mat3& world_from_parent = posed.world_from_segment[kBodyParent[s]].rotation;
        origin_rates[s] = origin_rates[kBodyParent[s]] + to_eigen(world_from_parent) * rates_.offsets[s];
        if (s == kUpperArmL || s == kUpperArmR) {
            const Vec3 along = posed.world_from_segment[s].rotation * Vec3{0, 0, -1};
            origin_rates[s].col(kShoulderRise) +=
                to_eigen(world_from_parent * BodyModel::risen(world_from_parent.transposed() * along));
        }
    }
    const auto frames = model.dof_frames(posed);
    system.mixed.setZero();
    system.shape.setZero();
    system.shape_gradient.setZero();
    Eigen::Matrix<double, 1, kBodyParameters> row;
    for (const SurfaceTerm& term : cost.terms()) {
        const ShapeRates::Capsule& c = rates_.capsules[term.capsule];
        const int segment = cost.capsules()[term.capsule].segment;
        const Eigen::Vector3d g = to_eigen(term.gradient);
        const Eigen::Vector3d in_segment =
            to_eigen(posed.world_from_segment[segment].rotation).transpose() * g;
        row = g.transpose() * origin_rates[segment] +
              in_segment.transpose() * ((1 - term.along) * c.a + term.along * c.b) +
              term.radius_gradient * ((1 - term.along) * c.radius_a + term.along * c.radius_b);
        system.shape.noalias() += term.weight * row.transpose() * row;
        system.shape_gradient += term.weight * term.residual * row.transpose();
        for (const int k : dofs_of_segment(segment)) {
            const DofFrame& f = frames[k];
            const double by_dof = dot(f.axis, cross(term.point_in_world - f.origin, term.gradient)) +
                                  dot(f.shift, term.gradient);
            system.mixed.row(k) += term.weight * by_dof * row;
        }
    }
}

}  // namespace kinevox
