#include "server/calibration/bundle.h"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <limits>
#include <memory>

#include "server/calibration/camera_cost.h"

namespace kinevox {
namespace {

struct CornerCost {
    std::array<double, kIntrinsicCount> intrinsics;  // unused where they are solved
    Vec3 point_in_thing;
    Vec3 velocity_in_world, acceleration_in_world;
    Vec2 pixel;

    template <class T>
    bool with(const T* lens, const T* camera_from_world, const T* world_from_thing, const T* delay,
              T* residual) const {
        const T point[3] = {T(point_in_thing.x), T(point_in_thing.y), T(point_in_thing.z)};
        T in_world[3], in_camera[3], seen[2];
        transform(world_from_thing, point, in_world);
        const T half_square = T(0.5) * *delay * *delay;
        in_world[0] += *delay * velocity_in_world.x + half_square * acceleration_in_world.x;
        in_world[1] += *delay * velocity_in_world.y + half_square * acceleration_in_world.y;
        in_world[2] += *delay * velocity_in_world.z + half_square * acceleration_in_world.z;
        transform(camera_from_world, in_world, in_camera);
        if (!project_in_camera(lens, in_camera, seen)) return false;
        residual[0] = seen[0] - T(pixel.x);
        residual[1] = seen[1] - T(pixel.y);
        return true;
    }
    template <class T>
    bool operator()(const T* camera_from_world, const T* world_from_thing, const T* delay,
                    T* residual) const {
        T lens[kIntrinsicCount];
        for (int i = 0; i < kIntrinsicCount; ++i) lens[i] = T(intrinsics[i]);
        return with(lens, camera_from_world, world_from_thing, delay, residual);
    }
    template <class T>
    bool operator()(const T* lens, const T* camera_from_world, const T* world_from_thing, const T* delay,
                    T* residual) const {
        return with(lens, camera_from_world, world_from_thing, delay, residual);
    }
};

// A moment is as far as a curve through a moment and its neighbours may be trusted.
struct DelayPrior {
    template <class T>
    bool operator()(const T* delay, T* residual) const {
        residual[0] = *delay / T(1.0);
        return true;
    }
};

// Holds a lens near what it was.
struct LensPrior {
    std::array<double, kIntrinsicCount> mean, std;
    double aspect_std;
    template <class T>
    bool operator()(const T* lens, T* residual) const {
        for (int i = 0; i < kIntrinsicCount; ++i) residual[i] = (lens[i] - T(mean[i])) / T(std[i]);
        residual[kIntrinsicCount] = (lens[0] - lens[1]) / T(aspect_std * mean[0]);
        return true;
    }
};

struct ProgressCallback final : ceres::IterationCallback {
    const SolveProgress& progress;
    int most;
    bool cancelled = false;
    ProgressCallback(const SolveProgress& progress, int most) : progress(progress), most(most) {}
    ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
        // Most solves end long before their last allowed step.
        const double part = 1 - std::exp(-4.0 * summary.iteration / most);
        if (progress && !progress(part, fmt::format("bundle adjustment, step {}", summary.iteration)))
            cancelled = true;
        return cancelled ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
    }
};

std::array<double, kIntrinsicCount> prior_deviations(const Camera& camera, const BundleOptions& options) {
    std::array<double, kIntrinsicCount> std;
    std.fill(options.distortion_std);
    std[0] = options.focal_std_part * camera.fx, std[1] = options.focal_std_part * camera.fy;
    std[2] = std[3] = options.centre_std_part * camera.width;
    std[6] = std[7] = 0.02 * options.distortion_std;
    if (camera.k3 == 0) std[8] = 1e-9;
    return std;
}

}  // namespace

Vec3 observed_point(const Bundle& bundle, const BundleObservation& o) {
    const double delay = bundle.delay.empty() ? 0 : bundle.delay[o.camera];
    return bundle.world_from_thing[o.moment] * bundle.points_in_thing[o.point] + delay * o.velocity_in_world +
           0.5 * delay * delay * o.acceleration_in_world;
}

absl::Status place_held_out(const Bundle& fit, BundleOptions options, Bundle& held_out,
                            BundleReport& report) {
    if (held_out.observations.empty()) return absl::OkStatus();
    held_out.cameras = fit.cameras;
    held_out.delay = fit.delay;
    options.free_intrinsics = options.free_delays = false;
    options.fixed_cameras = true;
    return solve_bundle(held_out, options, report);
}

BundleReport measure_bundle(const Bundle& bundle) {
    BundleReport report;
    double sum = 0;
    std::size_t count = 0;
    for (const BundleObservation& o : bundle.observations) {
        const auto seen = bundle.cameras[o.camera].project(observed_point(bundle, o));
        const double error = seen ? std::hypot(seen->x - o.pixel.x, seen->y - o.pixel.y) : std::nan("");
        report.errors_px.push_back(error);
        if (!seen) continue;
        sum += error * error, ++count;
    }
    report.rms_px = count ? std::sqrt(sum / static_cast<double>(count)) : std::nan("");
    return report;
}

absl::Status solve_bundle(Bundle& bundle, const BundleOptions& options, BundleReport& report,
                          const SolveProgress& progress) {
    if (bundle.observations.empty())
        return absl::FailedPreconditionError("no observations; show the board to the cameras");
    std::vector<std::array<double, kPoseCount>> cameras(bundle.cameras.size()),
        moments(bundle.world_from_thing.size());
    std::vector<std::array<double, kIntrinsicCount>> lenses(bundle.cameras.size());
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        to_parameters(bundle.cameras[c].camera_from_world, cameras[c].data());
        to_parameters(bundle.cameras[c], lenses[c].data());
    }
    std::vector<double> delays = bundle.delay;
    delays.resize(cameras.size(), 0);
    for (std::size_t m = 0; m < moments.size(); ++m)
        to_parameters(bundle.world_from_thing[m], moments[m].data());

    ceres::Problem::Options problem_options;
    problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    const ceres::CauchyLoss loss(options.robust_px);
    ceres::Problem problem(problem_options);
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    std::vector<bool> used(cameras.size(), false);
    for (const BundleObservation& o : bundle.observations) {
        auto* cost = new CornerCost{lenses[o.camera], bundle.points_in_thing[o.point], o.velocity_in_world,
                                    o.acceleration_in_world, o.pixel};
        auto* robust = const_cast<ceres::CauchyLoss*>(&loss);
        if (options.free_intrinsics)
            problem.AddResidualBlock(
                new ceres::AutoDiffCostFunction<CornerCost, 2, kIntrinsicCount, kPoseCount, kPoseCount, 1>(
                    cost),
                robust, lenses[o.camera].data(), cameras[o.camera].data(), moments[o.moment].data(),
                &delays[o.camera]);
        else
            problem.AddResidualBlock(
                new ceres::AutoDiffCostFunction<CornerCost, 2, kPoseCount, kPoseCount, 1>(cost), robust,
                cameras[o.camera].data(), moments[o.moment].data(), &delays[o.camera]);
        used[o.camera] = true;
        ordering->AddElementToGroup(moments[o.moment].data(), 0);
    }
    if (options.fixed_turns)
        for (auto& moment : moments)
            if (problem.HasParameterBlock(moment.data()))
                problem.SetManifold(moment.data(), new ceres::SubsetManifold(kPoseCount, {0, 1, 2}));
    bool anchored = false, scaled = false;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        if (!used[c]) continue;
        ordering->AddElementToGroup(cameras[c].data(), 1);
        ordering->AddElementToGroup(&delays[c], 1);
        if (!anchored || options.fixed_cameras) {
            problem.SetParameterBlockConstant(cameras[c].data());
        } else if (options.fixed_turns && !scaled) {
            // Points alone leave the scale open: one length stays what it is.
            int axis = 3;
            for (int k = 4; k < kPoseCount; ++k)
                if (std::abs(cameras[c][k]) > std::abs(cameras[c][axis])) axis = k;
            problem.SetManifold(cameras[c].data(), new ceres::SubsetManifold(kPoseCount, {axis}));
            scaled = true;
        }
        if (!anchored || !options.free_delays || options.fixed_cameras)
            problem.SetParameterBlockConstant(&delays[c]);
        else
            problem.AddResidualBlock(new ceres::AutoDiffCostFunction<DelayPrior, 1, 1>(new DelayPrior),
                                     nullptr, &delays[c]);
        anchored = true;
        if (!options.free_intrinsics) continue;
        ordering->AddElementToGroup(lenses[c].data(), 1);
        problem.AddResidualBlock(
            new ceres::AutoDiffCostFunction<LensPrior, kIntrinsicCount + 1, kIntrinsicCount>(
                new LensPrior{lenses[c], prior_deviations(bundle.cameras[c], options), options.aspect_std}),
            nullptr, lenses[c].data());
    }

    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::DENSE_SCHUR;
    solver.linear_solver_ordering = ordering;
    solver.max_num_iterations = options.max_iterations;
    solver.function_tolerance = 1e-9;
    // The turn of a wand about itself is seen by nobody: some damping always remains, or nothing could be
    // solved.
    solver.min_lm_diagonal = 1e-3;
    solver.max_trust_region_radius = 1e6;
    solver.num_threads = options.threads;
    solver.logging_type = ceres::SILENT;
    ProgressCallback callback(progress, options.max_iterations);
    solver.callbacks.push_back(&callback);
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem, &summary);
    if (callback.cancelled) return absl::CancelledError("stopped; nothing was changed");
    if (!summary.IsSolutionUsable())
        return absl::InternalError("the bundle adjustment found no answer; " + summary.message);

    for (std::size_t c = 0; c < cameras.size(); ++c) {
        bundle.cameras[c].camera_from_world = to_rigid(cameras[c].data());
        set_intrinsics(lenses[c].data(), bundle.cameras[c]);
    }
    for (std::size_t m = 0; m < moments.size(); ++m) bundle.world_from_thing[m] = to_rigid(moments[m].data());
    if (options.free_delays && !options.fixed_cameras) bundle.delay = delays;
    report = measure_bundle(bundle);
    report.iterations = static_cast<int>(summary.iterations.size());
    return absl::OkStatus();
}

}  // namespace kinevox
