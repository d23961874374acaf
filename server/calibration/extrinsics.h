// All cameras' places from a board moved through the space, seen by two or more cameras at a time, in any
// order.
#pragma once

#include <absl/status/statusor.h>

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board_detector.h"
#include "server/calibration/bundle.h"
#include "server/calibration/finding.h"

namespace kinevox {

struct ExtrinsicsOptions {
    int held_out_every = 5;      // every so many moments are kept out of the fit and measure it; 0: none
    bool solve_delays = true;    // cameras that take their pictures a little later than others: webcams
    double max_shift_px = 2;     // views that such a delay shifts by more are left out: hold the board still
    bool refine_lenses = false;  // the lenses may move a little too; for lenses fitted from few views
    double max_edge_px = 8;      // blurrier views are left out
    double max_view_rms_px = 4;  // views whose own pose misses by more are left out
    int max_moments = 500;       // evenly taken from more
    double robust_px = 1.0;
    int threads = 2;
};

struct PixelMiss {
    Vec2 pixel;    // where a point was seen
    Vec2 miss_px;  // by how much farther than where it should be
};

struct CameraQuality {
    int views = 0;  // used in the fit
    double fit_rms_px = 0;
    std::optional<double> held_out_rms_px;
    double coverage = 0;               // part of the picture, 0 to 1, by the views used
    std::vector<int> coverage_counts;  // see Coverage
    std::vector<PixelMiss> misses;  // evenly some of the points held out, or of those fitted where none were
};

// Distances between points of the board, triangulated, against the print. mm per metre.
struct ScaleError {
    double bias_mm_per_m = 0, spread_mm_per_m = 0;  // mean; standard deviation
    int distances = 0;
};

struct ExtrinsicsResult {
    std::vector<Camera>
        cameras;  // solved ones; world: the best connected camera's frame until a floor is set
    std::vector<std::string> left_out;   // cameras that share no view with these
    std::vector<CameraQuality> quality;  // per camera
    double fit_rms_px = 0;
    std::optional<double> held_out_rms_px;
    std::optional<ScaleError> scale;         // on held-out moments
    std::vector<double> delays;              // per camera, in moments: how much later than the first
    std::map<int, Rigid3> world_from_board;  // by moment
    std::vector<Vec3> seen_points;  // corners in the world that two or more cameras saw: the volume covered
    std::vector<Finding> findings;
};

// Not thread safe.
class ExtrinsicsProcedure {
  public:
    // The cameras' lenses; their places are not used.
    ExtrinsicsProcedure(std::vector<Camera> lenses, const BoardSpec& board,
                        const ExtrinsicsOptions& options = {});

    // What camera `camera` saw at `moment` (frame sets counted from 0, in any order).
    void add_observation(int moment, int camera, const BoardSighting& sighting);
    // "camera c3 has not seen the board", "cameras c1 and c4 have not seen it together".
    std::vector<std::string> hints() const;
    bool complete() const;

    // FailedPrecondition with the remedy where too little was seen, Cancelled by `progress`.
    absl::StatusOr<ExtrinsicsResult> solve(const SolveProgress& progress = {}) const;

  private:
    struct View {
        int camera = 0;
        std::vector<Corner> corners;
    };
    std::vector<Camera> lenses_;
    BoardSpec board_;
    ExtrinsicsOptions options_;
    std::map<int, std::vector<View>> moments_;
    std::vector<int> mirrored_, blurred_;  // pictures, per camera
};

}  // namespace kinevox
