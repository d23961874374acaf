// A camera's lens from views of a board: which views to use, the fit, how sure it is, what is wrong with it.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board_detector.h"
#include "server/calibration/coverage.h"
#include "server/calibration/finding.h"

namespace kinevox {

struct IntrinsicsOptions {
    bool k3 = false;              // a third radial coefficient; for very wide lenses
    int max_views = 40;           // the most informative ones are used
    double max_edge_px = 6;       // views whose edges are blurred wider are rejected, and those
    double max_edge_ratio = 2.2;  // wider than so many times the median
    double min_tilt_deg = 6;      // a board nearer to parallel with the picture tells no focal length: it is
                                  // rejected unless it covers a part of the picture that no other view does
    double same_view_part =
        0.015;  // of the picture's width: views whose corners moved less than this are one view
};

enum class ViewUse { kUsed, kSpare, kNotFound, kMirrored, kBlurred, kSameAsBefore, kParallel, kDoesNotFit };

struct IntrinsicsView {
    int frame = 0;
    ViewUse use = ViewUse::kSpare;
    std::string reason;   // in words, for all that was not used
    double rms_px = 0;    // used and spare ones, after the solve
    double tilt_deg = 0;  // of the board against the picture's plane
    std::vector<Corner> corners;
};

struct IntrinsicsResult {
    Camera camera;
    std::array<double, 9> std_deviations{};  // fx fy cx cy (px) k1 k2 p1 p2 k3
    double rms_px = 0;                       // of the views used
    std::optional<double> held_out_rms_px;   // of the spare ones, the board's pose fitted to each
    double coverage = 0;                     // part of the picture, 0 to 1
    std::vector<int> coverage_counts;        // see Coverage
    int used = 0;
    std::vector<IntrinsicsView> views;
    std::vector<Finding> findings;
};

// One camera's procedure. Not thread safe.
class IntrinsicsProcedure {
  public:
    IntrinsicsProcedure(std::string camera, int width, int height, const BoardSpec& board,
                        const IntrinsicsOptions& options = {});

    // What becomes of the view so far; kSpare where it may be used.
    IntrinsicsView add_observation(int frame, const BoardSighting& sighting);
    // Views that may be used, and what the operator should do next: "camera c2: hold the board at the left
    // edge".
    int usable() const;
    std::vector<std::string> hints() const;
    // Enough is there; more views would add little.
    bool complete() const;

    // FailedPrecondition with the remedy where the views do not suffice, Cancelled by `progress`.
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

}  // namespace kinevox
