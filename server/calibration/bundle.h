// Bundle adjustment: cameras that see a rigid thing (a board, a wand) at many moments. Minimises the robust
// reprojection error over all cameras' places and the thing's pose at every moment.
#pragma once

#include <absl/status/status.h>

#include <vector>

#include "common/camera.h"
#include "server/calibration/finding.h"

namespace kinevox {

struct BundleObservation {
    int camera = 0, moment = 0, point = 0;  // indices
    Vec2 pixel;
    // Of the point, m per moment and per moment squared: for cameras whose clocks are not the same.
    Vec3 velocity_in_world, acceleration_in_world;
};

struct Bundle {
    std::vector<Camera> cameras;           // in: a guess; out: solved. The first stays where it is
    std::vector<Vec3> points_in_thing;     // m; the metric scale comes from these
    std::vector<Rigid3> world_from_thing;  // per moment; in: a guess; out: solved
    std::vector<BundleObservation> observations;
    // Per camera, by how much later than the first one it takes its pictures, in moments; empty: all at once.
    std::vector<double> delay;
};

struct BundleOptions {
    double robust_px = 1.0;  // errors beyond this count linearly at first, then less and less (Cauchy)
    bool free_intrinsics =
        false;  // f, c and distortion too, each held near what it is by the deviations below
    double focal_std_part = 0.1, centre_std_part = 0.03,
           distortion_std = 0.1;  // the centre's: of the picture's width
    double aspect_std = 0.004;    // pixels are as high as wide, to so much
    bool free_delays = false;     // Bundle::delay is solved too
    bool fixed_cameras = false;   // only the thing's poses are solved
    bool fixed_turns = false;     // the thing is a point that has no attitude
    int max_iterations = 100;
    int threads = 2;
};

struct BundleReport {
    double rms_px = 0;              // root mean square over the observations, each two coordinates together
    std::vector<double> errors_px;  // per observation; NaN behind the camera
    int iterations = 0;
};

// Where the observed point was when the camera saw it, m.
Vec3 observed_point(const Bundle& bundle, const BundleObservation& observation);

// FailedPrecondition where there is nothing to solve, Internal where the solver finds no finite answer,
// Cancelled by `progress`.
absl::Status solve_bundle(Bundle& bundle, const BundleOptions& options, BundleReport& report,
                          const SolveProgress& progress = {});

// The thing's poses at the moments of `held_out`, by the cameras of `fit`, which stay where they are; nothing
// where it has no observations.
absl::Status place_held_out(const Bundle& fit, BundleOptions options, Bundle& held_out, BundleReport& report);

// The errors as they stand.
BundleReport measure_bundle(const Bundle& bundle);

}  // namespace kinevox
