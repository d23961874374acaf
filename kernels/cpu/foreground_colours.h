// The colours seen on the subject, as a histogram that forgets: what tells a brown trouser from a shaded
// floor.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/types.h"

namespace kinevox::kernels::cpu {

class ForegroundColours {
  public:
    explicit ForegroundColours(int channels);

    // Log density per bin: `share` of the histogram and the rest uniform.
    void log_density(float share, std::vector<float>& per_bin) const;

    // Counts of one picture, one entry a bin; what was known before keeps `memory` of its weight.
    void add(const std::vector<std::int32_t>& counts, float memory);
    void clear();
    int bins() const { return static_cast<int>(weight_.size()); }

  private:
    int channels_;
    std::vector<float> weight_;
};

}  // namespace kinevox::kernels::cpu
