#include "server/pose/body_fitter.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "common/geometry.h"
#include "common/to_eigen.h"
#include "server/pose/body_prior.h"
#include "server/pose/floating_body.h"
#include "server/pose/pose_fitter.h"
#include "server/pose/retrack.h"

namespace kinevox {
namespace {

constexpr int kParameters = kBodyParameters, kStature = kStatureParameter;
constexpr double kCertain = 0.9;  // minimum probability of a posture that is used
// Minimum explained fraction of a frame set's contour, relative to the median of all.
constexpr double kMinExplained = 0.8;
constexpr std::size_t kHeldOutFrames = 8, kHeldOutInterval = 6;

// Starts of the fit, relative to the given body; one of the others replaces it if it costs clearly less.
constexpr std::array<double, 3> kStartScales{1, 0.88, 1.14};
constexpr double kClearlyBetter = 0.9, kCostWithoutPose = 5000;

// Another start of the fit, hair relative to the stature: from little hair, the head may tilt back instead.
constexpr double kLongHair = 0.035, kHeadForwards_rad = 15 * kDegree;

constexpr double kMinGrowth_m = 0.02;  // of the stature by legs that stand: a raised heel adds less
constexpr double kFloatingCost = 5;    // negative log odds of a subject that stands on something invisible
// Robust kernels of standing: of the fit, and narrower that of the poses, since people jump.
constexpr double kStandingFit_m = 0.15, kStandingPose_m = 0.05;

using PoseVector = Eigen::Matrix<double, kBodyDofCount, 1>;
using PoseMatrix = Eigen::Matrix<double, kBodyDofCount, kBodyDofCount>;
using ShapeVector = BodyVector;
using ShapeMatrix = BodyMatrix;
using MixedMatrix = Eigen::Matrix<double, kBodyDofCount, kParameters>;
using PointByShape = Eigen::Matrix<double, 3, kParameters>;

// Derivatives of joints and capsules in their segments' frames by the lengths: constant, since all are
// linear.
struct ShapeRates {
    struct Capsule {
        PointByShape a, b;
        Eigen::Matrix<double, 1, kParameters> radius_a, radius_b;
    };
    std::array<PointByShape, kBodySegmentCount> offsets;
    std::vector<Capsule> capsules;

    explicit ShapeRates(const BodyShape& shape) {
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
                offsets[s].col(k) =
                    to_eigen((model.offset_in_parent(s) - base.offset_in_parent(s)) / kStep_m);
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
};

// The normal equations of one frame set, and their Schur complement after eliminating the posture.
struct FrameSystem {
    Linearisation pose;
    MixedMatrix mixed;
    ShapeMatrix shape;
    ShapeVector shape_gradient;
    Eigen::LDLT<PoseMatrix> factor;
};

void add_shape(const ShapeRates& rates, const BodyModel& model, const PoseCost& cost, FrameSystem& system) {
    const PosedBody& posed = cost.posed();
    std::array<PointByShape, kBodySegmentCount> origin_rates;
    origin_rates[kPelvis].setZero();
    for (int s = 1; s < kBodySegmentCount; ++s) {
        const Mat3& world_from_parent = posed.world_from_segment[kBodyParent[s]].rotation;
        origin_rates[s] = origin_rates[kBodyParent[s]] + to_eigen(world_from_parent) * rates.offsets[s];
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
    Eigen::Matrix<double, 1, kParameters> row;
    for (const SurfaceTerm& term : cost.terms()) {
        const ShapeRates::Capsule& c = rates.capsules[term.capsule];
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

class JointFit {
  public:
    JointFit(std::vector<const PoseObservation*> frames, std::vector<BodyPosture> postures,
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

    // All frame sets count as `independent` ones: their errors are correlated, as the surface only
    // approximates the body.
    // Returns the cost.
    double descend(double robust_m, int steps, double independent) {
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
    // The same with long hair, and so with the head less far back.
    void grow_hair() {
        shape_[kHairBack] = kLongHair * shape_.stature_m;
        const Mat3 forwards = rotation_y(kHeadForwards_rad);
        for (BodyPosture& posture : postures_)
            posture.parent_from_segment[kHead] = posture.parent_from_segment[kHead] * forwards;
    }
    const BodyShape& shape() const { return shape_; }
    const std::vector<BodyPosture>& postures() const { return postures_; }
    void set_standing(std::size_t n) { costs_[n].set_standing(kStandingFit_m); }
    // How unusual the body is.
    double prior_cost() const {
        ShapeMatrix hessian = ShapeMatrix::Zero();
        ShapeVector gradient = ShapeVector::Zero();
        return prior_.add(shape_, hessian, gradient);
    }
    // Per frame set, of its contour.
    std::vector<double> explained_fractions(double narrow_m) const {
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
    // Standard deviations of the lengths and, last, the stature, with free postures.
    std::array<double, kParameters> std_m() {
        eliminate(0);
        const ShapeMatrix covariance = reduced_hessian().ldlt().solve(ShapeMatrix::Identity());
        std::array<double, kParameters> std;
        for (int k = 0; k < kParameters; ++k) std[k] = std::sqrt(std::max(0.0, covariance(k, k)));
        return std;
    }
    double rms_m() const {
        double sum = 0;
        std::size_t count = 0;
        for (const PoseCost& cost : costs_)
            for (const SurfaceTerm& term : cost.terms())
                if (term.radius_gradient < 0 && std::abs(term.residual) < 3 * robust_m_)
                    sum += term.residual * term.residual, ++count;
        return count > 0 ? std::sqrt(sum / static_cast<double>(count)) : 0;
    }

  private:
    double linearise(const BodyShape& shape, const std::vector<BodyPosture>& postures) {
        const BodyModel model(shape);
        oneapi::tbb::parallel_for(std::size_t{0}, frames_.size(), [&](std::size_t n) {
            costs_[n].linearise(model, postures[n], frames_[n]->views, nullptr, robust_m_, systems_[n].pose);
            add_shape(rates_, model, costs_[n], systems_[n]);
        });
        usual_.setZero();
        usual_gradient_.setZero();
        double cost = prior_.add(shape, usual_, usual_gradient_);
        for (const FrameSystem& system : systems_) cost += share_ * system.pose.cost;
        return cost;
    }

    // Factorises the posture block of each frame set.
    void eliminate(double damping) {
        oneapi::tbb::parallel_for(std::size_t{0}, frames_.size(), [&](std::size_t n) {
            PoseMatrix damped = systems_[n].pose.hessian;
            damped.diagonal() += damping * systems_[n].pose.hessian.diagonal();
            damped.diagonal().array() += 1;
            systems_[n].factor.compute(damped);
        });
    }

    ShapeMatrix reduced_hessian() const {
        ShapeMatrix hessian = usual_;
        for (const FrameSystem& s : systems_)
            hessian += share_ * (s.shape - s.mixed.transpose() * s.factor.solve(s.mixed));
        return hessian;
    }

    void step(double damping, BodyShape& shape, std::vector<BodyPosture>& postures) {
        eliminate(damping);
        ShapeMatrix hessian = reduced_hessian();
        ShapeVector gradient = usual_gradient_;
        for (const FrameSystem& s : systems_)
            gradient += share_ * (s.shape_gradient - s.mixed.transpose() * s.factor.solve(s.pose.gradient));
        hessian.diagonal() *= 1 + damping;
        const ShapeVector change = hessian.ldlt().solve(-gradient);
        for (int k = 0; k < kBodyLengthCount; ++k)
            shape.lengths_m[k] = std::max(0.004, shape.lengths_m[k] + change(k));
        shape.stature_m = std::clamp(shape.stature_m + change(kStature), 0.6, 2.4);
        for (std::size_t n = 0; n < postures.size(); ++n) {
            PoseVector d =
                systems_[n].factor.solve(-(systems_[n].pose.gradient + systems_[n].mixed * change));
            const double largest = d.tail<kBodyDofCount - 3>().cwiseAbs().maxCoeff();
            if (largest > 0.4) d *= 0.4 / largest;
            postures[n] =
                stepped(postures[n], std::span<const double, kBodyDofCount>(d.data(), kBodyDofCount));
        }
    }

    std::vector<const PoseObservation*> frames_;
    std::vector<BodyPosture> postures_;
    BodyShape shape_;
    BodyFitOptions options_;
    std::stop_token stop_;
    ShapeRates rates_;
    BodyPrior prior_;
    double robust_m_ = 0, share_ = 1;
    std::vector<PoseCost> costs_;
    std::vector<FrameSystem> systems_;
    ShapeMatrix usual_;
    ShapeVector usual_gradient_;
};

std::vector<ObservedPosture> tracked_postures(const std::vector<Camera>& cameras, double fps,
                                              std::span<const PoseObservation* const> frames,
                                              const PoseStageOptions& posing, const std::stop_token& stop,
                                              const std::function<void(double)>& report) {
    PoseStage stage(cameras, fps, posing);
    std::vector<ObservedPosture> posed;
    for (std::size_t n = 0; n < frames.size() && !stop.stop_requested(); ++n) {
        report(static_cast<double>(n) / static_cast<double>(frames.size()));
        if (stage.process(0, 0, frames[n]->time_ns, *frames[n], {}) && stage.tracked())
            posed.push_back({frames[n], stage.tracked()->fit.posture});
    }
    return posed;
}

// Without those of frame sets that allow other postures, unless that leaves too few.
std::vector<ObservedPosture> postures_on_path(const std::vector<Camera>& cameras, double fps,
                                              std::span<const PoseObservation* const> frames,
                                              const PoseStageOptions& posing, const std::stop_token& stop) {
    std::vector<RecordedView> views;
    for (const PoseObservation* frame : frames) views.push_back({0, 0, frame});
    const std::vector<RetrackedFrame> path = retrack(cameras, fps, views, posing, kRetrackRounds, stop);
    std::vector<ObservedPosture> all, certain;
    for (std::size_t n = 0; n < path.size(); ++n) {
        if (!path[n].posture) continue;
        all.push_back({frames[n], *path[n].posture});
        if (path[n].probability > kCertain) certain.push_back(all.back());
    }
    return 2 * certain.size() >= all.size() ? certain : all;
}

// At most `count` of them, evenly over time.
template <typename T>
std::vector<T> evenly(const std::vector<T>& all, std::size_t count) {
    if (all.size() <= count) return all;
    std::vector<T> some;
    for (std::size_t n = 0; n < count; ++n) some.push_back(all[n * all.size() / count]);
    return some;
}

BodyShape scaled(const BodyShape& shape, double factor) {
    BodyShape larger = shape;
    larger.stature_m *= factor;
    for (double& length : larger.lengths_m) length *= factor;
    return larger;
}

// A tracker whose body is much too small or too large finds wrong postures, to which the lengths would adapt.
// Of the start and its scaled forms, the one in whose poses a few single frame sets cost least.
BodyShape start_of_right_size(const std::vector<Camera>& cameras, double fps,
                              std::span<const PoseObservation* const> frames, const BodyShape& start,
                              const PoseStageOptions& posing, const BodyFitOptions& options,
                              const std::stop_token& stop) {
    if (options.stature_m) return scaled(start, *options.stature_m / start.stature_m);
    const auto tried = evenly(std::vector<const PoseObservation*>(frames.begin(), frames.end()),
                              static_cast<std::size_t>(options.size_frames));
    std::array<double, kStartScales.size()> cost{};
    std::vector<double> costs(kStartScales.size() * tried.size());
    oneapi::tbb::parallel_for(std::size_t{0}, costs.size(), [&](std::size_t k) {
        if (stop.stop_requested()) return;
        PoseStageOptions sized = posing;
        sized.tracker.search_at_start = !options.quick;
        sized.body = scaled(start, kStartScales[k / tried.size()]);
        PoseStage stage(cameras, fps, sized);
        const PoseObservation& seen = *tried[k % tried.size()];
        costs[k] = stage.process(0, 0, seen.time_ns, seen, {}) ? stage.data_cost() : kCostWithoutPose;
    });
    for (std::size_t k = 0; k < costs.size(); ++k) cost[k / tried.size()] += costs[k];
    const auto best = static_cast<std::size_t>(std::min_element(cost.begin(), cost.end()) - cost.begin());
    return cost[best] < kClearlyBetter * cost[0] ? scaled(start, kStartScales[best]) : start;
}

// Frame sets of one posture see the same errors of the surface: they count as one. Others count up to
// `max_count`, as far as their postures spread.
double independent_count(const BodyShape& shape, std::span<const ObservedPosture> posed, double max_count) {
    constexpr double kVaried_m = 0.15;  // RMS distance of the joints, seen from the root, from their means
    const BodyModel model(shape);
    std::array<Vec3, kJointNames.size()> sum{};
    double squares = 0;
    for (const ObservedPosture& p : posed) {
        const PosedBody body = model.forward(p.posture);
        for (std::size_t j = 0; j < sum.size(); ++j) {
            const Vec3 from_root = body.joints_in_world[j] - p.posture.root_in_world;
            sum[j] = sum[j] + from_root;
            squares += dot(from_root, from_root);
        }
    }
    const auto count = static_cast<double>(posed.size());
    for (const Vec3& s : sum) squares -= dot(s, s) / count;
    const double spread_m = std::sqrt(std::max(0.0, squares) / (count * static_cast<double>(sum.size())));
    return 1 + (std::max(1.0, max_count) - 1) * std::min(1.0, spread_m / kVaried_m);
}

// Of a body that floats above the floor, the fit with its feet on it, if that is a likely body.
std::optional<JointFit> stand(const JointFit& floating, std::span<const ObservedPosture> posed, bool stood,
                              double narrow_m, int steps, double independent) {
    std::vector<std::int64_t> times_ns;
    for (const ObservedPosture& p : posed) times_ns.push_back(p.frame->time_ns);
    const std::vector<std::size_t> frames =
        floating_frames(BodyModel(floating.shape()), floating.postures(), times_ns, stood);
    if (frames.empty()) return std::nullopt;
    JointFit standing = floating;
    for (const std::size_t n : frames) standing.set_standing(n);
    standing.descend(2 * narrow_m, steps, 1);
    standing.descend(narrow_m, steps, independent);
    if (standing.shape().stature_m < floating.shape().stature_m + kMinGrowth_m ||
        standing.prior_cost() > floating.prior_cost() + kFloatingCost)
        return std::nullopt;
    return standing;
}

// The cost of this body, each posture fitted again.
double cost_with(const BodyShape& shape, std::span<const ObservedPosture> posed,
                 const PoseFitOptions& options) {
    const BodyModel model(shape);
    std::vector<double> costs(posed.size());
    oneapi::tbb::parallel_for(std::size_t{0}, posed.size(), [&](std::size_t n) {
        PoseFitter fitter(options);
        costs[n] = fitter.fit(model, posed[n].frame->views, posed[n].posture, nullptr, false).at.cost;
    });
    return std::accumulate(costs.begin(), costs.end(), 0.0);
}

}  // namespace

double girth_std_m(const BodyFit& fit, const BodyGirthInfo& girth) {
    const auto moved = [&](BodyLength which) {
        BodyShape wider = fit.shape;
        wider[which] += fit.lengths_std_m[which];
        return girth_m(wider, girth) - girth_m(fit.shape, girth);
    };
    return girth.half_width == girth.half_depth
               ? moved(girth.half_width)
               : std::hypot(moved(girth.half_width), moved(girth.half_depth));
}

std::optional<BodyFit> fit_lengths(std::span<const ObservedPosture> all, const BodyShape& start, bool stood,
                                   const PoseStageOptions& posing, const BodyFitOptions& options,
                                   const std::stop_token& stop) {
    const PoseFitOptions& fitting = posing.tracker.fit;
    // Some are held out for the verification.
    const auto most = static_cast<std::size_t>(options.max_frames);
    const bool enough = std::min(all.size(), most) >= 3 * kHeldOutFrames;
    const auto posed =
        evenly(std::vector<ObservedPosture>(all.begin(), all.end()), enough ? most + kHeldOutFrames : most);
    std::vector<ObservedPosture> held_out, used;
    for (std::size_t n = 0; n < posed.size(); ++n)
        (enough && n % kHeldOutInterval == kHeldOutInterval / 2 ? held_out : used).push_back(posed[n]);
    std::optional<JointFit> joint;
    const auto start_with = [&](std::span<const ObservedPosture> with) {
        std::vector<const PoseObservation*> observations;
        std::vector<BodyPosture> postures;
        for (const ObservedPosture& p : with) observations.push_back(p.frame), postures.push_back(p.posture);
        joint.emplace(std::move(observations), std::move(postures), start, posing, options, stop);
    };
    start_with(used);
    const double cost = joint->descend(2 * fitting.narrow_m, options.steps, 1);
    JointFit with_hair = *joint;
    with_hair.grow_hair();
    if (with_hair.descend(2 * fitting.narrow_m, options.steps, 1) < cost) joint = std::move(with_hair);
    // A frame set that the body explains much worse than the others has bad silhouettes or a wrong pose.
    const std::vector<double> explained = joint->explained_fractions(fitting.narrow_m);
    std::vector<double> sorted = explained;
    std::sort(sorted.begin(), sorted.end());
    std::vector<ObservedPosture> good;
    for (std::size_t n = 0; n < used.size(); ++n)
        if (explained[n] >= kMinExplained * sorted[sorted.size() / 2])
            good.push_back({used[n].frame, joint->postures()[n]});
    if (good.size() < used.size()) {
        start_with(good);
        joint->descend(2 * fitting.narrow_m, options.steps, 1);
    }
    joint->descend(fitting.narrow_m, options.steps, 1);
    const double independent = independent_count(start, good, options.independent_frames);
    joint->descend(fitting.narrow_m, options.steps, independent);
    std::optional<JointFit> standing =
        stand(*joint, good, stood, fitting.narrow_m, options.steps, independent);
    BodyFit fit;
    fit.standing_m = standing ? kStandingPose_m : 0;
    if (standing) joint = std::move(standing);
    // Lengths that do not help where they were not fitted are the population's.
    const BodyShape usual = default_body_shape(joint->shape().stature_m);
    const bool confirmed = held_out.empty() || cost_with(joint->shape(), held_out, fitting) <=
                                                   cost_with(usual, held_out, fitting);
    fit.shape = confirmed ? joint->shape() : usual;
    const auto std_m = joint->std_m();
    for (int k = 0; k < kBodyLengthCount; ++k)
        fit.lengths_std_m[k] = confirmed ? std_m[k] : kBodyLengths[k].relative_std * usual.lengths_m[k];
    fit.stature_std_m = std_m[kStature];
    fit.contour_residual_rms_m = joint->rms_m();
    fit.frame_set_count = static_cast<int>(good.size());
    if (stop.stop_requested()) return std::nullopt;
    return fit;
}

absl::StatusOr<BodyFit> fit_body(const std::vector<Camera>& cameras, double fps,
                                 std::span<const PoseObservation* const> frames, const BodyShape& start,
                                 const PoseStageOptions& posing, const BodyFitOptions& options,
                                 std::stop_token stop, const std::function<void(double)>& progress) {
    PoseStageOptions unfiltered = posing;
    unfiltered.filtered = false;
    BodyFit fit;
    fit.shape = start_of_right_size(cameras, fps, frames, start, unfiltered, options, stop);
    for (int round = 0; round < options.rounds; ++round) {
        PoseStageOptions stage_options = unfiltered;
        stage_options.body = fit.shape;
        stage_options.tracker.always_search_limbs = true;
        stage_options.tracker.fit.cost.standing_m = fit.standing_m;
        stage_options.tracker.lost_explained_fraction = options.min_explained_fraction;
        // The last round takes the path through the whole recording: a limb lost for a while would be fitted,
        // too.
        const bool along_path = round + 1 == options.rounds && !options.quick;
        const auto report = [&](double fraction) {
            if (progress) progress((round + 0.8 * fraction) / options.rounds);
        };
        const std::vector<ObservedPosture> posed =
            along_path ? postures_on_path(cameras, fps, frames, stage_options, stop)
                       : tracked_postures(cameras, fps, frames, stage_options, stop, report);
        if (stop.stop_requested()) return absl::CancelledError("the body fit was cancelled");
        if (posed.empty())
            return absl::FailedPreconditionError(fmt::format(
                "no person's pose was found in {} frame sets; fit the body where one person stands free",
                frames.size()));
        const std::optional<BodyFit> fitted =
            fit_lengths(posed, fit.shape, fit.standing_m > 0, posing, options, stop);
        if (!fitted) return absl::CancelledError("the body fit was cancelled");
        fit = *fitted;
    }
    return fit;
}

}  // namespace kinevox
