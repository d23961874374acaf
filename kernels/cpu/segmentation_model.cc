#include "kernels/cpu/segmentation_model.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

#include "kernels/shared/kde_evidence.h"

namespace kinevox::kernels::cpu {

using kde::kCellPixels;

void check_image(const ImageView& image, int width, int height, int channels) {
    if (image.data && image.width == width && image.height == height && image.channels == channels) return;
    throw std::invalid_argument("segmentation: an image of " + std::to_string(image.width) + " x " +
                                std::to_string(image.height) + " with " + std::to_string(image.channels) +
                                " channels does not match a model of " + std::to_string(width) + " x " +
                                std::to_string(height) + " with " + std::to_string(channels) +
                                "; relearn the background from this camera's images");
}

std::array<std::uint16_t, 3> fixed_point_inverse(const GainBgr& gain) {
    std::array<std::uint16_t, 3> inverse{};
    for (int c = 0; c < 3; ++c)
        inverse[c] = static_cast<std::uint16_t>(std::clamp(std::lround(16384.0 / gain[c]), 1l, 65535l));
    return inverse;
}

int median_bin(std::span<const int> histogram) {
    const int half = std::accumulate(histogram.begin(), histogram.end(), 0) / 2;
    int below = 0;
    for (int bin = 0; bin < static_cast<int>(histogram.size()); ++bin)
        if ((below += histogram[bin]) > half) return bin;
    return 0;
}

GainBgr estimate_gain(const BackgroundModel& model, const ImageView& image) {
    constexpr int kBins = 1024, kOne = 256;
    struct Pair {
        std::uint8_t value, reference;
    };
    GainBgr gain{1, 1, 1};
    // Whole stretches of few rows: each line of memory that is fetched serves many pixels.
    const int row_step = std::max(1, model.height / 20);
    std::array<std::vector<Pair>, 3> pairs;
    for (int c = 0; c < model.channels; ++c)
        pairs[c].reserve(static_cast<std::size_t>(model.height / row_step + 1) * (model.width / 4 + 1));
    for (int y = row_step / 2; y < model.height; y += row_step) {
        const std::uint8_t* row = image.row(y);
        for (int x = y % 4; x < model.width; x += 4) {
            const std::uint8_t* references = model.cell_reference(y, x / kCellPixels) + x % kCellPixels;
            for (int c = 0; c < model.channels; ++c) {
                const Pair pair{row[x * model.channels + c], references[c * kCellPixels]};
                if (pair.reference >= 24 && pair.reference <= 235 && pair.value < 250)
                    pairs[c].push_back(pair);
            }
        }
    }
    for (int c = 0; c < model.channels; ++c) {
        std::vector<int> histogram(kBins, 0);
        const int total = static_cast<int>(pairs[c].size());
        for (const Pair& p : pairs[c])
            ++histogram[std::min(kBins - 1, (p.value * kOne + p.reference / 2) / p.reference)];
        if (total < 50) continue;
        const float centre = static_cast<float>(median_bin(histogram)) / kOne;
        std::int64_t values = 0, references = 0;
        for (const Pair& p : pairs[c])
            if (std::abs(p.value - centre * p.reference) < 0.04f * p.reference + 1.0f)
                values += p.value, references += p.reference;
        if (references > 0)
            gain[c] = std::clamp(static_cast<float>(static_cast<double>(values) / references), 0.3f, 3.5f);
    }
    return gain;
}

std::uint8_t scale_of_bandwidth(float bandwidth) {
    return static_cast<std::uint8_t>(std::clamp(std::lround(256.0f / bandwidth), 8l, 255l));
}

const std::array<float, 256>& log_scales() {
    static const std::array<float, 256> kTable = [] {
        std::array<float, 256> table{};
        for (int i = 1; i < 256; ++i) table[i] = std::log(static_cast<float>(i) / 256.0f);
        return table;
    }();
    return kTable;
}

void update_log_peak(BackgroundModel& model, std::size_t cell) {
    const float* log_scale = log_scales().data();
    const std::uint8_t* scale = model.bandwidth_scale.data() + cell * model.cell_bytes();
    for (int x = 0; x < kCellPixels; ++x)
        model.log_peak[cell * kCellPixels + x] = kde::log_peak_of(log_scale, scale + x, model.channels);
}

}  // namespace kinevox::kernels::cpu
