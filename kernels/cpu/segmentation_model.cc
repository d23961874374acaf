#include "kernels/cpu/segmentation_model.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "kernels/shared/kde_evidence.h"

namespace kinevox::kernels::cpu {

using kde::kCellPixels;

std::array<std::uint16_t, 3> fixed_point_inverse(const GainBgr& gain) {
    std::array<std::uint16_t, 3> inverse{};
    for (int c = 0; c < 3; ++c)
        inverse[c] = static_cast<std::uint16_t>(std::clamp(std::lround(16384.0 / gain[c]), 1l, 65535l));
    return inverse;
}

GainBgr estimate_gain(const BackgroundModel& model, const PictureView& picture) {
    constexpr int kBins = 1024, kOne = 256;
    GainBgr gain{1, 1, 1};
    for (int c = 0; c < model.channels; ++c) {
        std::vector<int> histogram(kBins, 0);
        int total = 0;
        // Whole stretches of few rows: each line of memory that is fetched serves many pixels.
        const int row_step = std::max(1, model.height / 20);
        const auto visit = [&](auto&& each) {
            for (int y = row_step / 2; y < model.height; y += row_step)
                for (int x = y % 4; x < model.width; x += 4) {
                    const int reference =
                        model.cell_reference(y, x / kCellPixels)[c * kCellPixels + x % kCellPixels];
                    const int value = picture.row(y)[x * model.channels + c];
                    if (reference >= 24 && reference <= 235 && value < 250) each(value, reference);
                }
        };
        visit([&](int value, int reference) {
            ++histogram[std::min(kBins - 1, (value * kOne + reference / 2) / reference)];
            ++total;
        });
        if (total < 50) continue;
        int median = 0;
        for (int below = 0; median < kBins && below + histogram[median] <= total / 2; ++median)
            below += histogram[median];
        const float centre = static_cast<float>(median) / kOne;
        std::int64_t values = 0, references = 0;
        visit([&](int value, int reference) {
            if (std::abs(value - centre * reference) < 0.04f * reference + 1.0f)
                values += value, references += reference;
        });
        if (references > 0)
            gain[c] = std::clamp(static_cast<float>(static_cast<double>(values) / references), 0.3f, 3.5f);
    }
    return gain;
}

std::uint8_t scale_of_bandwidth(float bandwidth) {
    return static_cast<std::uint8_t>(std::clamp(std::lround(256.0f / bandwidth), 8l, 255l));
}

void update_log_peak(BackgroundModel& model, std::size_t cell) {
    static const std::array<float, 256> kLogScale = [] {
        std::array<float, 256> table{};
        for (int i = 1; i < 256; ++i) table[i] = std::log(static_cast<float>(i) / 256.0f);
        return table;
    }();
    for (int x = 0; x < kCellPixels; ++x) {
        float log_peak = kde::kLogGaussianPeak * static_cast<float>(model.channels);
        for (int c = 0; c < model.channels; ++c)
            log_peak += kLogScale[model.bandwidth_scale[cell * model.cell_bytes() + c * kCellPixels + x]];
        model.log_peak[cell * kCellPixels + x] = log_peak;
    }
}

}  // namespace kinevox::kernels::cpu
