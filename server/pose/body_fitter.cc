#include "server/pose/body_fitter.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "server/pose/body_prior.h"
#include "server/pose/floating_body.h"
#include "server/pose/joint_fit.h"
#include "server/pose/pose_fitter.h"
#include "server/pose/retrack.h"

namespace kinevox {
namespace {

constexpr double kCertain = 0.9;  // minimum probability of a posture that is used
// Minimum explained fraction of a frame set's contour, relative to the median of all.
constexpr double kMinExplained = 0.8;
constexpr std::size_t kHeldOutFrames = 8, kHeldOutInterval = 6;

// Starts of the fit, relative to the given body; one of the others replaces it if it costs clearly less.
constexpr std::array<double, 3> kStartScales{1, 0.88, 1.14};
constexpr double kClearlyBetter = 0.9, kCostWithoutPose = 5000;

// Of the stature by legs that stand: a raised heel adds hardly more than the first and less than the second.
constexpr double kMinGrowth_m = 0.02, kMinHiddenGrowth_m = 0.05;
constexpr double kFloatingCost = 5;       // negative log odds of a subject that stands on something invisible
constexpr double kStandingPose_m = 0.05;  // robust kernel of standing, narrow since people jump

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

// What keeps a body inside the silhouettes makes feet small that these do not show.
BodyShape with_usual_feet(BodyShape shape) {
    const BodyShape usual = default_body_shape(shape.stature_m);
    for (const BodyLength length : {kAnkleToToe, kFootRadius}) shape[length] = usual[length];
    return shape;
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
    BodyShape before = floating.shape(), after = standing.shape();
    const double growth_m = after.stature_m - before.stature_m;
    if (growth_m < kMinGrowth_m) return std::nullopt;
    if (growth_m > kMinHiddenGrowth_m) before = with_usual_feet(before), after = with_usual_feet(after);
    if (floating.prior_cost(after) > floating.prior_cost(before) + kFloatingCost) return std::nullopt;
    standing.set_shape(after);
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
    fit.stature_std_m = std_m[kStatureParameter];
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
