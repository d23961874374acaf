#include "server/calibration/bundle.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>

namespace kinevox {
namespace {

// Projection as a template for Ceres' automatic differentiation.
constexpr int kIntrinsicCount = 9;  // fx fy cx cy k1 k2 p1 p2 k3
constexpr int kPoseCount = 6;       // Rodrigues vector, translation

// Camera::project for a point in the camera frame; false behind the camera.
template <class T>
bool project_in_camera(const T* intrinsics, const T point[3], T pixel[2]) {
    if (!(point[2] > T(1e-6))) return false;
    const T x = point[0] / point[2], y = point[1] / point[2];
    const T r2 = x * x + y * y;
    const T radial = T(1) + r2 * (intrinsics[4] + r2 * (intrinsics[5] + r2 * intrinsics[8]));
    const T &p1 = intrinsics[6], &p2 = intrinsics[7];
    pixel[0] = intrinsics[0] * (x * radial + T(2) * p1 * x * y + p2 * (r2 + T(2) * x * x)) + intrinsics[2];
    pixel[1] = intrinsics[1] * (y * radial + p1 * (r2 + T(2) * y * y) + T(2) * p2 * x * y) + intrinsics[3];
    return true;
}

template <class T>
void transform(const T* pose, const T point[3], T out[3]) {
    ceres::AngleAxisRotatePoint(pose, point, out);
    for (int i = 0; i < 3; ++i) out[i] += pose[3 + i];
}

void to_parameters(const Rigid3& transform, double pose[kPoseCount]) {
    const Vec3 r = rodrigues_from_rotation(transform.rotation), t = transform.translation;
    const double values[kPoseCount] = {r.x, r.y, r.z, t.x, t.y, t.z};
    std::copy(values, values + kPoseCount, pose);
}
Rigid3 to_rigid(const double pose[kPoseCount]) {
    return {rotation_from_rodrigues({pose[0], pose[1], pose[2]}), {pose[3], pose[4], pose[5]}};
}
void to_parameters(const Camera& c, double intrinsics[kIntrinsicCount]) {
    const double values[kIntrinsicCount] = {c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2, c.k3};
    std::copy(values, values + kIntrinsicCount, intrinsics);
}
void set_intrinsics(const double in[kIntrinsicCount], Camera& c) {
    c.fx = in[0], c.fy = in[1], c.cx = in[2], c.cy = in[3];
    c.k1 = in[4], c.k2 = in[5], c.p1 = in[6], c.p2 = in[7], c.k3 = in[8];
}

struct CornerCost {
    std::array<double, kIntrinsicCount> fixed_intrinsics;  // unused if they are solved
    Vec3 point_in_target;
    Vec3 velocity_in_world, acceleration_in_world;
    Vec2 pixel;

    template <class T>
    bool with(const T* parameters, const T* camera_from_world, const T* world_from_target, const T* delay,
              T* residual) const {
        const T point[3] = {T(point_in_target.x), T(point_in_target.y), T(point_in_target.z)};
        T in_world[3], in_camera[3], seen[2];
        transform(world_from_target, point, in_world);
        const T half_square = T(0.5) * *delay * *delay;
        in_world[0] += *delay * velocity_in_world.x + half_square * acceleration_in_world.x;
        in_world[1] += *delay * velocity_in_world.y + half_square * acceleration_in_world.y;
        in_world[2] += *delay * velocity_in_world.z + half_square * acceleration_in_world.z;
        transform(camera_from_world, in_world, in_camera);
        if (!project_in_camera(parameters, in_camera, seen)) return false;
        residual[0] = seen[0] - T(pixel.x);
        residual[1] = seen[1] - T(pixel.y);
        return true;
    }
    template <class T>
    bool operator()(const T* camera_from_world, const T* world_from_target, const T* delay,
                    T* residual) const {
        T parameters[kIntrinsicCount];
        for (int i = 0; i < kIntrinsicCount; ++i) parameters[i] = T(fixed_intrinsics[i]);
        return with(parameters, camera_from_world, world_from_target, delay, residual);
    }
    template <class T>
    bool operator()(const T* parameters, const T* camera_from_world, const T* world_from_target,
                    const T* delay, T* residual) const {
        return with(parameters, camera_from_world, world_from_target, delay, residual);
    }
};

// A quadratic through neighbouring frame sets extrapolates by one frame interval at most.
struct DelayPrior {
    template <class T>
    bool operator()(const T* delay, T* residual) const {
        residual[0] = *delay / T(1.0);
        return true;
    }
};

// Keeps the intrinsics near their initial values.
struct IntrinsicsPrior {
    std::array<double, kIntrinsicCount> mean, std;
    double aspect_std;
    template <class T>
    bool operator()(const T* parameters, T* residual) const {
        for (int i = 0; i < kIntrinsicCount; ++i) residual[i] = (parameters[i] - T(mean[i])) / T(std[i]);
        residual[kIntrinsicCount] = (parameters[0] - parameters[1]) / T(aspect_std * mean[0]);
        return true;
    }
};

struct ProgressCallback final : ceres::IterationCallback {
    const SolveProgress& progress;
    int max_iterations;
    bool cancelled = false;
    ProgressCallback(const SolveProgress& progress, int max_iterations)
        : progress(progress), max_iterations(max_iterations) {}
    ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
        // Most solves converge long before the last iteration.
        const double fraction = 1 - std::exp(-4.0 * summary.iteration / max_iterations);
        if (progress &&
            !progress(fraction, fmt::format("bundle adjustment, iteration {}", summary.iteration)))
            cancelled = true;
        return cancelled ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
    }
};

std::array<double, kIntrinsicCount> prior_stds(const Camera& camera, const BundleOptions& options) {
    std::array<double, kIntrinsicCount> std;
    std.fill(options.distortion_std);
    std[0] = options.focal_std_fraction * camera.fx, std[1] = options.focal_std_fraction * camera.fy;
    std[2] = std[3] = options.centre_std_fraction * camera.width;
    std[6] = std[7] = 0.02 * options.distortion_std;
    if (camera.k3 == 0) std[8] = 1e-9;
    return std;
}

ceres::Problem::Options without_loss_ownership() {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
}

// The parameter blocks of a bundle and Ceres' problem on them.
struct BundleProblem {
    const Bundle& bundle;
    const BundleOptions& options;
    std::vector<std::array<double, kPoseCount>> cameras, frame_sets;
    std::vector<std::array<double, kIntrinsicCount>> intrinsics;
    std::vector<double> delays;
    std::vector<bool> used;
    ceres::CauchyLoss loss;  // outlives the problem
    ceres::Problem problem{without_loss_ownership()};
    std::shared_ptr<ceres::ParameterBlockOrdering> ordering =
        std::make_shared<ceres::ParameterBlockOrdering>();

    BundleProblem(const Bundle& bundle, const BundleOptions& options)
        : bundle(bundle),
          options(options),
          cameras(bundle.cameras.size()),
          frame_sets(bundle.world_from_target.size()),
          intrinsics(bundle.cameras.size()),
          delays(bundle.delay),
          used(bundle.cameras.size(), false),
          loss(options.robust_px) {
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            to_parameters(bundle.cameras[c].camera_from_world, cameras[c].data());
            to_parameters(bundle.cameras[c], intrinsics[c].data());
        }
        delays.resize(cameras.size(), 0);
        for (std::size_t m = 0; m < frame_sets.size(); ++m)
            to_parameters(bundle.world_from_target[m], frame_sets[m].data());
    }

    void add_observations() {
        for (const BundleObservation& o : bundle.observations) {
            auto* cost = new CornerCost{intrinsics[o.camera], bundle.points_in_target[o.point],
                                        o.velocity_in_world, o.acceleration_in_world, o.pixel};
            if (options.free_intrinsics)
                problem.AddResidualBlock(new ceres::AutoDiffCostFunction<CornerCost, 2, kIntrinsicCount,
                                                                         kPoseCount, kPoseCount, 1>(cost),
                                         &loss, intrinsics[o.camera].data(), cameras[o.camera].data(),
                                         frame_sets[o.frame_set].data(), &delays[o.camera]);
            else
                problem.AddResidualBlock(
                    new ceres::AutoDiffCostFunction<CornerCost, 2, kPoseCount, kPoseCount, 1>(cost), &loss,
                    cameras[o.camera].data(), frame_sets[o.frame_set].data(), &delays[o.camera]);
            used[o.camera] = true;
            ordering->AddElementToGroup(frame_sets[o.frame_set].data(), 0);
        }
        if (!options.fixed_rotations) return;
        for (auto& frame_set : frame_sets)
            if (problem.HasParameterBlock(frame_set.data()))
                problem.SetManifold(frame_set.data(), new ceres::SubsetManifold(kPoseCount, {0, 1, 2}));
    }

    // The first camera is the reference; with point targets one length keeps the scale.
    void constrain_cameras() {
        bool anchored = false, scaled = false;
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            if (!used[c]) continue;
            ordering->AddElementToGroup(cameras[c].data(), 1);
            ordering->AddElementToGroup(&delays[c], 1);
            if (!anchored || options.fixed_cameras) {
                problem.SetParameterBlockConstant(cameras[c].data());
            } else if (options.fixed_rotations && !scaled) {
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
            ordering->AddElementToGroup(intrinsics[c].data(), 1);
            problem.AddResidualBlock(
                new ceres::AutoDiffCostFunction<IntrinsicsPrior, kIntrinsicCount + 1, kIntrinsicCount>(
                    new IntrinsicsPrior{intrinsics[c], prior_stds(bundle.cameras[c], options),
                                        options.aspect_std}),
                nullptr, intrinsics[c].data());
        }
    }

    void store(Bundle& to) const {
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            to.cameras[c].camera_from_world = to_rigid(cameras[c].data());
            set_intrinsics(intrinsics[c].data(), to.cameras[c]);
        }
        for (std::size_t m = 0; m < frame_sets.size(); ++m)
            to.world_from_target[m] = to_rigid(frame_sets[m].data());
        if (options.free_delays && !options.fixed_cameras) to.delay = delays;
    }
};

}  // namespace

Vec3 observed_point(const Bundle& bundle, const BundleObservation& o) {
    const double delay = bundle.delay.empty() ? 0 : bundle.delay[o.camera];
    return bundle.world_from_target[o.frame_set] * bundle.points_in_target[o.point] +
           delay * o.velocity_in_world + 0.5 * delay * delay * o.acceleration_in_world;
}

absl::Status solve_held_out_poses(const Bundle& fit, BundleOptions options, Bundle& held_out,
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
    BundleProblem problem(bundle, options);
    problem.add_observations();
    problem.constrain_cameras();

    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::DENSE_SCHUR;
    solver.linear_solver_ordering = problem.ordering;
    solver.max_num_iterations = options.max_iterations;
    solver.function_tolerance = 1e-9;
    // No camera observes the rotation of a wand about its own axis: some damping always remains, or the
    // system would be singular.
    solver.min_lm_diagonal = 1e-3;
    solver.max_trust_region_radius = 1e6;
    solver.num_threads = options.threads;
    solver.logging_type = ceres::SILENT;
    ProgressCallback callback(progress, options.max_iterations);
    solver.callbacks.push_back(&callback);
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem.problem, &summary);
    if (callback.cancelled) return absl::CancelledError("stopped; nothing was changed");
    if (!summary.IsSolutionUsable())
        return absl::InternalError("the bundle adjustment did not converge: " + summary.message);

    problem.store(bundle);
    report = measure_bundle(bundle);
    report.iterations = static_cast<int>(summary.iterations.size());
    return absl::OkStatus();
}

}  // namespace kinevox
