// A camera's intrinsics from views of a board: view selection, fit, standard deviations and findings.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board/board_detector.h"
#include "server/calibration/coverage.h"
#include "server/calibration/finding.h"

namespace kinevox {

struct IntrinsicsOptions {
    bool k3 = false;              // a third radial distortion coefficient, for very wide angles
    int max_views = 40;           // the most informative ones
    double max_edge_px = 6;       // views with wider edges are rejected
    double max_edge_ratio = 2.2;  // and those with edges wider than this multiple of the median
    double min_tilt_deg = 6;      // views closer to parallel with the image plane do not determine the focal
                                  // length: rejected unless they cover a new image region
    double same_view_fraction = 0.015;  // of the image width: views whose corners moved less are duplicates
};

enum class ViewUse { kUsed, kUnused, kNotFound, kMirrored, kBlurred, kDuplicate, kParallel, kOutlier };

struct IntrinsicsView {
    int frame = 0;
    ViewUse use = ViewUse::kUnused;
    std::string reason;   // why it was not used
    double rms_px = 0;    // of used and unused views, after the solve
    double tilt_deg = 0;  // board against the image plane
    std::vector<Corner> corners;
};

struct IntrinsicsResult {
    Camera camera;
    std::array<double, 9> stds{};           // fx fy cx cy (px) k1 k2 p1 p2 k3
    double rms_px = 0;                      // of the views used
    std::optional<double> held_out_rms_px;  // of the unused views, with the board's pose fitted to each
    double coverage = 0;                    // covered fraction of the image, 0 to 1
    std::vector<int> coverage_counts;       // see Coverage
    int used = 0;
    std::vector<IntrinsicsView> views;
    std::vector<Finding> findings;
};

// One camera's procedure. Not thread safe.
class IntrinsicsProcedure {
  public:
    IntrinsicsProcedure(std::string camera, int width, int height, const BoardSpec& board,
                        const IntrinsicsOptions& options = {});

    // Classifies the view; kUnused if it may be used.
    IntrinsicsView add_observation(int frame, const BoardDetection& detection);
    // Number of usable views, and hints: "camera c2: hold the board at the left edge".
    int usable() const;
    std::vector<std::string> hints() const;
    // True if more views would add little.
    bool complete() const;

    // FailedPrecondition with the remedy if the views do not suffice, Cancelled by `progress`.
    absl::StatusOr<IntrinsicsResult> solve(const SolveProgress& progress = {}) const;

  private:
    std::string camera_;
    int width_, height_;
    BoardSpec board_;
    IntrinsicsOptions options_;
    Coverage coverage_;
    std::vector<IntrinsicsView> views_;
    std::vector<double> edges_px_;  // per view
};

// Numerics of IntrinsicsProcedure: OpenCV's fit and the information that each view adds.

class IntrinsicsSolver {
  public:
    IntrinsicsSolver(std::string camera, int width, int height, std::vector<Vec3> board_points, bool k3);
    ~IntrinsicsSolver();

    // Initial intrinsics from a few evenly spread views; false if none fit.
    bool start(const std::vector<IntrinsicsView*>& views);
    // Fills tilt_deg with the current intrinsics.
    void measure_tilts(const std::vector<IntrinsicsView*>& views) const;
    // Keeps the most informative views: greedily the one that most lowers the determinant of the parameters'
    // covariance, until the gain becomes small. The others become unused.
    void select_informative(std::vector<IntrinsicsView*>& views, std::size_t most) const;
    // Fills camera, stds and rms_px, the views' rms_px and use. False if no fit is found.
    bool solve(const std::vector<IntrinsicsView*>& views, IntrinsicsResult& result);
    // Fills rms_px of the unused views and held_out_rms_px.
    void measure_unused(IntrinsicsResult& result) const;

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace kinevox
