// Bundle adjustment for cameras that observe a rigid target (board or wand) in many frame sets. Minimises the
// robust reprojection error over all camera poses and the target's pose in every frame set.
#pragma once

#include <absl/status/status.h>

#include <vector>

#include "common/camera.h"
#include "server/calibration/finding.h"

namespace kinevox {

struct BundleObservation {
    int camera = 0, frame_set = 0, point = 0;  // indices
    Vec2 pixel;
    // Motion of the point, m per frame interval and its square: for cameras that are not synchronised.
    Vec3 velocity_in_world, acceleration_in_world;
};

struct Bundle {
    std::vector<Camera> cameras;            // in: initial guess; out: solution. The first camera stays fixed
    std::vector<Vec3> points_in_target;     // m; they define the metric scale
    std::vector<Rigid3> world_from_target;  // per frame set; in: initial guess; out: solution
    std::vector<BundleObservation> observations;
    // Per camera, its delay against the first one, in frame intervals; empty: synchronised.
    std::vector<double> delay;
};

struct BundleOptions {
    double robust_px = 1.0;  // scale of the Cauchy loss
    bool free_intrinsics =
        false;  // refine focal length, principal point and distortion, with the priors below
    double focal_std_fraction = 0.1, centre_std_fraction = 0.03,
           distortion_std = 0.1;   // of the image width
    double aspect_std = 0.004;     // prior standard deviation of fx / fy
    bool free_delays = false;      // Bundle::delay is solved, too
    bool fixed_cameras = false;    // only the target's poses are solved
    bool fixed_rotations = false;  // the target is a point without orientation
    int max_iterations = 100;
    int threads = 2;
};

struct BundleReport {
    double rms_px = 0;              // root mean square of the 2-D reprojection errors
    std::vector<double> errors_px;  // per observation; NaN behind the camera
    int iterations = 0;
};

// Position of the observed point at the exposure of its camera, m.
Vec3 observed_point(const Bundle& bundle, const BundleObservation& observation);

// FailedPrecondition without observations, Internal if the solver finds no finite solution, Cancelled by
// `progress`.
absl::Status solve_bundle(Bundle& bundle, const BundleOptions& options, BundleReport& report,
                          const SolveProgress& progress = {});

// Solves the target's poses of `held_out` with the cameras of `fit` fixed. Does nothing without observations.
absl::Status solve_held_out_poses(const Bundle& fit, BundleOptions options, Bundle& held_out,
                                  BundleReport& report);

// Errors at the current state.
BundleReport measure_bundle(const Bundle& bundle);

}  // namespace kinevox
