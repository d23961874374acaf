#include "kernels/cpu/segmentation_model.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/segmentation_density.h"
#include "kernels/shared/kde_evidence.h"

namespace kinevox::kernels::cpu {
namespace {

using kde::kCellPixels;

constexpr int kMaxLearnPictures = 128;

void split_picture(const BackgroundModel& model, const PictureView& picture, const GainBgr& gain,
                   AlignedVector<std::uint8_t>& cells) {
    cells.resize(model.cell_index(model.height, 0) * model.cell_bytes());
    const auto inverse = fixed_point_inverse(gain);
    parallel_for(0, model.height, 32, [&](int first, int last) {
        for (int y = first; y < last; ++y)
            for (int cell = 0; cell < model.cells_per_row; ++cell) {
                const int x = cell * kCellPixels;
                split_cell(picture.row(y) + x * picture.channels, std::min(kCellPixels, picture.width - x),
                           picture.channels, inverse.data(),
                           cells.data() + model.cell_index(y, cell) * model.cell_bytes());
            }
    });
}

template <class T>
T median_of(T* values, int count) {
    std::nth_element(values, values + count / 2, values + count);
    return values[count / 2];
}

}  // namespace

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

BackgroundModel learn_background(std::span<const PictureView> empty_scene, int width, int height,
                                 int channels, const SegmentationOptions& options) {
    BackgroundModel model;
    model.width = width, model.height = height, model.channels = channels;
    model.sample_count = options.samples;
    model.cells_per_row = (width + kCellPixels - 1) / kCellPixels;
    const int given = static_cast<int>(empty_scene.size());
    const int used = std::min(given, std::max(kMaxLearnPictures, options.samples));
    const auto nth = [&](int i) { return empty_scene[static_cast<std::int64_t>(i) * given / used]; };
    const std::size_t plane_bytes = model.cell_index(height, 0) * model.cell_bytes();

    // Two rounds: the middle picture is the first reference for the gains, the mean of all the second.
    std::vector<AlignedVector<std::uint8_t>> pictures(used);
    split_picture(model, nth(used / 2), {1, 1, 1}, model.reference);
    for (int i = 0; i < used; ++i) split_picture(model, nth(i), estimate_gain(model, nth(i)), pictures[i]);

    model.bandwidth_scale.resize(plane_bytes);
    model.samples.resize(plane_bytes * model.sample_count);
    const bool noise_known = used >= 5;
    model.candidate.assign(plane_bytes, 0);
    model.candidate_visits.assign(plane_bytes / channels, 0);
    model.log_peak.resize(plane_bytes / channels);
    parallel_for(0, height * model.cells_per_row, 64, [&](int first, int last) {
        std::vector<float> steps(used);
        for (int cell = first; cell < last; ++cell) {
            for (std::size_t k = 0; k < model.cell_bytes(); ++k) {
                const std::size_t at = cell * model.cell_bytes() + k;
                int sum = 0;
                for (int i = 0; i < used; ++i) sum += pictures[i][at];
                model.reference[at] = static_cast<std::uint8_t>((sum + used / 2) / used);
                float bandwidth = options.assumed_noise;
                if (noise_known) {
                    // Grey levels are whole numbers: spreading each difference over its bin gives the median
                    // the fraction that the mean has.
                    for (int i = 0; i + 1 < used; ++i)
                        steps[i] = std::abs(static_cast<float>(pictures[i + 1][at]) - pictures[i][at]) +
                                   static_cast<float>(i % 8) / 8 - 0.4375f;
                    const float middle = median_of(steps.data(), used - 1);
                    bandwidth = std::max(middle / (0.68f * std::sqrt(2.0f)), options.min_bandwidth);
                }
                model.bandwidth_scale[at] =
                    static_cast<std::uint8_t>(std::clamp(std::lround(256.0f / bandwidth), 8l, 255l));
                for (int i = 0; i < model.sample_count; ++i) {
                    const int from =
                        used >= model.sample_count
                            ? static_cast<int>(static_cast<std::int64_t>(i) * used / model.sample_count)
                            : i % used;
                    const std::size_t to =
                        (static_cast<std::size_t>(cell) * model.sample_count + i) * model.cell_bytes() + k;
                    model.samples[to] = pictures[from][at];
                }
            }
            update_log_peak(model, cell);
        }
    });
    return model;
}

}  // namespace kinevox::kernels::cpu
