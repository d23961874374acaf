// Smooths postures over time. Bone lengths are preserved, since angles are smoothed and not positions.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/pose_options.h"

namespace kinevox {

class OneEuroPosture {
  public:
    explicit OneEuroPosture(const OneEuroOptions& options = {}) : options_(options) {}
    BodyPosture filter(const BodyPosture& measured, std::int64_t time_ns);
    void reset() { last_.reset(); }

  private:
    OneEuroOptions options_;
    std::optional<BodyPosture> last_, last_measured_;
    std::int64_t last_time_ns_ = 0;
    BodyStep rate_{};
};

// A second-order Butterworth filter, forwards and backwards (zero phase, fourth order in total), for a whole
// recording. Absent postures stay absent; the runs between them are filtered separately, mirrored at their
// ends. `cutoff_hz`: one that applied_cutoff_hz() allows, above 0.
void smooth_zero_phase(std::vector<std::optional<BodyPosture>>& postures, double fps, double cutoff_hz);
// The cutoff to use at a frame rate; 0: none. Few samples per period of it are not filtered: a fast limb
// would leave its silhouettes.
double applied_cutoff_hz(double cutoff_hz, double fps);

}  // namespace kinevox
