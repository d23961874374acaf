#include "kernels/cpu/foreground_colours.h"

#include <algorithm>
#include <cmath>

#include "kernels/shared/kde_evidence.h"

namespace kinevox::kernels::cpu {
namespace {

int bin_count(int channels) {
    int bins = 1;
    for (int c = 0; c < channels; ++c) bins *= kde::kHistogramBins;
    return bins;
}

}  // namespace

ForegroundColours::ForegroundColours(int channels)
    : channels_(channels), weight_(bin_count(channels), 0.0f) {}

void ForegroundColours::clear() {
    std::fill(weight_.begin(), weight_.end(), 0.0f);
}

void ForegroundColours::log_density(float weight, std::vector<float>& per_bin) const {
    double total = 0;
    for (float w : weight_) total += w;
    const float uniform = std::exp(kde::kLogUniformLevel * static_cast<float>(channels_));
    per_bin.assign(weight_.size(), kde::kLogUniformLevel * static_cast<float>(channels_));
    if (total < 1) return;
    // A bin spans 16 levels of each channel.
    const auto of_histogram =
        static_cast<float>(weight / total * static_cast<double>(weight_.size()) * uniform);
    const float rest = (1 - weight) * uniform;
    const float empty = std::log(rest);
    for (std::size_t i = 0; i < weight_.size(); ++i)
        per_bin[i] = weight_[i] > 0 ? std::log(rest + of_histogram * weight_[i]) : empty;
}

void ForegroundColours::add(const std::vector<std::int32_t>& counts, float memory) {
    for (std::size_t i = 0; i < weight_.size(); ++i) {
        const float kept = weight_[i] * memory;
        weight_[i] = (kept < 1e-3f ? 0.0f : kept) + static_cast<float>(counts[i]);
    }
}

}  // namespace kinevox::kernels::cpu
