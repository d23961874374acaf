// The table that `kinevox process` prints at its end.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "server/pipeline/frame_result.h"

namespace kinevox {

class RunSummary {
  public:
    void add(const FrameResult& result);
    // Several lines: frames, litres, per stage median and 99th percentile in ms.
    std::string text(double wall_s) const;
    std::int64_t frames() const { return static_cast<std::int64_t>(times_.size()); }

  private:
    std::vector<StageTimes> times_;
    std::vector<double> litres_;
};

// Of values in any order; q in 0..1, nearest rank. NaN for none.
double quantile(std::vector<double> values, double q);

}  // namespace kinevox
