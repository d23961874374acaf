// Numerics of IntrinsicsProcedure: OpenCV's fit and the information that each view adds.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "server/calibration/board/intrinsics.h"

namespace kinevox {

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
