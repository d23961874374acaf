#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/segmentation_density.h"
#include "kernels/cpu/segmentation_model.h"

namespace kinevox::kernels::cpu {
namespace {

using kde::kCellPixels;

constexpr int kMaxLearnImages = 128;
constexpr int kMinNoiseImages = 5;  // minimum number to measure the noise

// Grey levels are whole numbers: spreading each difference over its bin, in parts, gives the median the
// fraction that the mean has. Differences beyond the largest mean the largest bandwidth anyway, and so a key
// fits a byte.
constexpr int kParts = 8, kMaxDifference = 31;

// Bandwidth scales by the median's key.
std::array<std::uint8_t, 256> scale_of_median(float min_bandwidth) {
    std::array<std::uint8_t, 256> scales{};
    for (int key = 0; key < 256; ++key) {
        const float median = static_cast<float>(key) / kParts - 0.5f + 0.5f / kParts;
        // Of Gaussian noise the median of the differences is 0.68 sqrt(2) sigma.
        const float bandwidth = std::max(median / (0.68f * std::sqrt(2.0f)), min_bandwidth);
        scales[key] = scale_of_bandwidth(bandwidth);
    }
    return scales;
}

// The images' values of 64 pixels in one channel: image i at values + i * step.
struct PixelHistory {
    const std::uint8_t* values = nullptr;
    std::size_t step = 0;
    int images = 0;
};

void mean_of(const PixelHistory& history, std::uint8_t* mean) {
    std::uint16_t sum[kCellPixels] = {};  // 255 images at most
    for (int i = 0; i < history.images; ++i) {
        const std::uint8_t* value = history.values + i * history.step;
        for (int x = 0; x < kCellPixels; ++x) sum[x] = static_cast<std::uint16_t>(sum[x] + value[x]);
    }
    for (int x = 0; x < kCellPixels; ++x)
        mean[x] = static_cast<std::uint8_t>((sum[x] + history.images / 2) / history.images);
}

// The median of the differences from image to image, as a key. All pixels at once: the key is found bit
// by bit from how many are smaller, without a branch. `keys` is scratch of 64 bytes a image.
void median_step(const PixelHistory& history, std::uint8_t* keys, std::uint8_t* median) {
    const int steps = history.images - 1;
    for (int i = 0; i < steps; ++i) {
        const std::uint8_t* value = history.values + i * history.step;
        const std::uint8_t* next = value + history.step;
        std::uint8_t* key = keys + i * kCellPixels;
        for (int x = 0; x < kCellPixels; ++x) {
            const int difference = std::max(value[x], next[x]) - std::min(value[x], next[x]);
            key[x] = static_cast<std::uint8_t>(std::min(difference, kMaxDifference) * kParts + i % kParts);
        }
    }
    std::memset(median, 0, kCellPixels);
    for (int bit = 128; bit > 0; bit >>= 1) {
        std::uint8_t guess[kCellPixels], smaller[kCellPixels] = {};
        for (int x = 0; x < kCellPixels; ++x) guess[x] = static_cast<std::uint8_t>(median[x] | bit);
        for (int i = 0; i < steps; ++i) {
            const std::uint8_t* key = keys + i * kCellPixels;
            for (int x = 0; x < kCellPixels; ++x)
                smaller[x] = static_cast<std::uint8_t>(smaller[x] + (key[x] < guess[x]));
        }
        for (int x = 0; x < kCellPixels; ++x) median[x] = smaller[x] <= steps / 2 ? guess[x] : median[x];
    }
}

void split_row(const BackgroundModel& model, const ImageView& image, int y,
               const std::array<std::uint16_t, 3>& inverse_gain, std::uint8_t* cells) {
    for (int cell = 0; cell < model.cells_per_row; ++cell) {
        const int x = cell * kCellPixels;
        split_cell(image.row(y) + x * image.channels, std::min(kCellPixels, image.width - x), image.channels,
                   inverse_gain.data(), cells + cell * model.cell_bytes());
    }
}

}  // namespace

BackgroundModel learn_background(std::span<const ImageView> empty_scene, int width, int height, int channels,
                                 const SegmentationOptions& options) {
    BackgroundModel model;
    model.width = width, model.height = height, model.channels = channels;
    model.sample_count = options.samples;
    model.cells_per_row = (width + kCellPixels - 1) / kCellPixels;
    const int given = static_cast<int>(empty_scene.size());
    const int used = std::min(given, std::max(kMaxLearnImages, options.samples));
    const auto nth = [&](int i) { return empty_scene[static_cast<std::int64_t>(i) * given / used]; };
    const std::size_t plane_bytes = model.cell_index(height, 0) * model.cell_bytes();
    const std::size_t row_bytes = model.cells_per_row * model.cell_bytes();

    // Two rounds: the middle image is the first reference for the gains, the mean of all the second.
    model.reference.resize(plane_bytes);
    parallel_for(0, height, 32, [&](int first, int last) {
        for (int y = first; y < last; ++y)
            split_row(model, nth(used / 2), y, fixed_point_inverse({1, 1, 1}),
                      model.reference.data() + y * row_bytes);
    });
    std::vector<std::array<std::uint16_t, 3>> inverse_gains(used);
    parallel_for(0, used, 4, [&](int first, int last) {
        for (int i = first; i < last; ++i)
            inverse_gains[i] = fixed_point_inverse(estimate_gain(model, nth(i)));
    });

    model.bandwidth_scale.assign(plane_bytes, scale_of_bandwidth(options.assumed_noise));
    model.samples.resize(plane_bytes * model.sample_count);
    model.candidate.assign(plane_bytes, 0);
    model.candidate_visits.assign(plane_bytes / channels, 0);
    model.log_peak.resize(plane_bytes / channels);
    const std::array<std::uint8_t, 256> scales = scale_of_median(options.min_bandwidth);
    parallel_for(0, height, 8, [&](int first, int last) {
        AlignedVector<std::uint8_t> rows(used * row_bytes),
            keys(static_cast<std::size_t>(used) * kCellPixels);
        std::uint8_t median[kCellPixels];
        for (int y = first; y < last; ++y) {
            for (int i = 0; i < used; ++i)
                split_row(model, nth(i), y, inverse_gains[i], rows.data() + i * row_bytes);
            for (std::size_t at = 0; at < row_bytes; at += kCellPixels) {
                const PixelHistory history{rows.data() + at, row_bytes, used};
                mean_of(history, model.reference.data() + y * row_bytes + at);
                if (used < kMinNoiseImages) continue;
                median_step(history, keys.data(), median);
                std::uint8_t* scale = model.bandwidth_scale.data() + y * row_bytes + at;
                for (int x = 0; x < kCellPixels; ++x) scale[x] = scales[median[x]];
            }
            for (int k = 0; k < model.cells_per_row; ++k) {
                std::uint8_t* samples = model.cell_samples(y, k);
                for (int i = 0; i < model.sample_count; ++i) {
                    const int from =
                        used >= model.sample_count
                            ? static_cast<int>(static_cast<std::int64_t>(i) * used / model.sample_count)
                            : i % used;
                    std::memcpy(samples + i * model.cell_bytes(),
                                rows.data() + from * row_bytes + k * model.cell_bytes(), model.cell_bytes());
                }
                update_log_peak(model, model.cell_index(y, k));
            }
        }
    });
    return model;
}

}  // namespace kinevox::kernels::cpu
