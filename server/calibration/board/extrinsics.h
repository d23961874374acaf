// Extrinsics of all cameras from a moving board that two or more cameras detect at a time, in any order.
#pragma once

#include <absl/status/statusor.h>

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board/board_detector.h"
#include "server/calibration/bundle.h"
#include "server/calibration/finding.h"

namespace kinevox {

class PosedViews;

struct ExtrinsicsOptions {
    int held_out_every = 5;          // every Nth shared frame set is held out to measure the fit; 0: none
    bool solve_delays = true;        // estimate a delay per camera: for webcams, which are not triggered
    double max_shift_px = 2;         // views that such a delay shifts by more are excluded
    bool refine_intrinsics = false;  // refine the intrinsics, too: for intrinsics from few views
    double max_edge_px = 8;          // views with wider edges are excluded
    double max_view_rms_px = 4;      // views with a larger error of their own pose are excluded
    int max_frame_sets = 500;        // selected evenly
    double robust_px = 1.0;
    int threads = 2;
};

struct PixelResidual {
    Vec2 pixel;        // detected position
    Vec2 residual_px;  // detected minus projected
};

struct CameraReprojection {
    int views = 0;  // used in the fit
    double fit_rms_px = 0;
    std::optional<double> held_out_rms_px;
    double coverage = 0;               // covered fraction of the image, 0 to 1, by the views used
    std::vector<int> coverage_counts;  // see Coverage
    std::vector<PixelResidual>
        residuals;  // an even selection of held-out points, or of fitted points without held-out ones
};

// Distances between triangulated board points against the print. mm per metre.
struct ScaleError {
    double bias_mm_per_m = 0, spread_mm_per_m = 0;  // mean; standard deviation
    int distances = 0;
};

struct ExtrinsicsResult {
    std::vector<Camera>
        cameras;  // solved ones; world frame: the best connected camera, until a floor is defined
    std::vector<std::string> excluded_cameras;      // that share no view with the others
    std::vector<CameraReprojection> reprojections;  // per camera
    double fit_rms_px = 0;
    std::optional<double> held_out_rms_px;
    std::optional<ScaleError> scale;         // on held-out frame sets
    std::vector<double> delays;              // per camera, frame intervals after the first camera
    std::map<int, Rigid3> world_from_board;  // by frame set
    std::vector<Vec3> target_points;         // in world, m, seen by two or more cameras
    std::vector<Finding> findings;
};

// Not thread safe.
class ExtrinsicsProcedure {
  public:
    // `intrinsics`: the cameras; their poses are ignored.
    ExtrinsicsProcedure(std::vector<Camera> intrinsics, const BoardSpec& board,
                        const ExtrinsicsOptions& options = {});

    // Detection of camera `camera` in frame set `frame_set` (counted from 0, in any order).
    void add_observation(int frame_set, int camera, const BoardDetection& detection);
    // "camera c3 has not detected the board".
    std::vector<std::string> hints() const;
    bool complete() const;

    // FailedPrecondition with the remedy if the observations do not suffice, Cancelled by `progress`.
    absl::StatusOr<ExtrinsicsResult> solve(const SolveProgress& progress = {}) const;

  private:
    struct View {
        int camera = 0;
        std::vector<Corner> corners;
    };
    std::vector<Camera> intrinsics_;
    BoardSpec board_;
    ExtrinsicsOptions options_;
    std::map<int, std::vector<View>> frame_sets_;
    std::vector<int> mirrored_, blurred_;  // images, per camera
};

// Checks before and after the solve, shared with the wand's procedure; in extrinsics_checks.cc.

// Checks that need only the views: a mirrored print.
std::vector<Finding> check_views(const PosedViews& views);

// Distances between triangulated board points against the print.
std::optional<ScaleError> scale_error(const Bundle& bundle);

std::vector<CameraReprojection> camera_reprojections(const Bundle& fit, const BundleReport& fit_report,
                                                     const Bundle& held_out, const BundleReport& held_report);

enum class TargetKind { kBoard, kWand };

// Findings of the solved bundle: large errors and their cause (two cameras swapped, a camera moved
// meanwhile), too few views, poor coverage, uniform tilt.
void append_findings(const Bundle& bundle, TargetKind kind, ExtrinsicsResult& result);

}  // namespace kinevox
