// Histogram of the colours seen on the subject, with exponential forgetting: distinguishes brown trousers
// from a shaded floor.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/types.h"

namespace kinevox::kernels::cpu {

class ForegroundColours {
  public:
    explicit ForegroundColours(int channels);

    // Log density per bin: a mixture of the histogram with weight `weight` and a uniform density.
    void log_density(float weight, std::vector<float>& per_bin) const;

    // Counts of one image, one entry per bin; earlier counts are multiplied by `memory`.
    void add(const std::vector<std::int32_t>& counts, float memory);
    void clear();
    int bins() const { return static_cast<int>(weight_.size()); }

  private:
    int channels_;
    std::vector<float> weight_;
};

}  // namespace kinevox::kernels::cpu
