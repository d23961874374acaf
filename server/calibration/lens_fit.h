// The numerics of IntrinsicsProcedure: OpenCV's fit of a lens, and the information that each view adds.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "server/calibration/intrinsics.h"

namespace kinevox {

class LensFit {
  public:
    LensFit(std::string camera, int width, int height, std::vector<Vec3> board_points, bool k3);
    ~LensFit();

    // A rough lens from some views spread over `views`; false where none fits.
    bool start(const std::vector<IntrinsicsView*>& views);
    // Fills tilt_deg with the lens as known so far.
    void measure_tilts(const std::vector<IntrinsicsView*>& views) const;
    // Leaves in `views` the ones that tell most about the lens: greedily, that which lowers the determinant
    // of the parameters' covariance most, until the next would hardly lower it. The others become spare.
    void select_informative(std::vector<IntrinsicsView*>& views, std::size_t most) const;
    // The fit; fills camera, std_deviations and rms_px, the views' rms_px and use. False where none is found.
    bool solve(const std::vector<IntrinsicsView*>& views, IntrinsicsResult& result);
    // rms_px of the spare views and held_out_rms_px.
    void measure_spare(IntrinsicsResult& result) const;

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace kinevox
