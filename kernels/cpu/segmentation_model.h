// The background model of one camera: samples, bandwidths and the reference image, all in cells of 64
// pixels.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "kernels/cpu/aligned_vector.h"
#include "kernels/segmentation.h"
#include "kernels/shared/kde_density.h"
#include "kernels/shared/kde_update.h"

namespace kinevox::kernels {

// The CPU form; arguments as make_segmenter(), already checked.
std::unique_ptr<Segmenter> make_segmenter_cpu(int width, int height, int channels,
                                              const SegmentationOptions& options);

}  // namespace kinevox::kernels

namespace kinevox::kernels::cpu {

using GainBgr = std::array<float, 3>;  // brightness of the image over that of the model, per channel

struct BackgroundModel {
    int width = 0, height = 0, channels = 0, sample_count = 0;
    int cells_per_row = 0;
    AlignedVector<std::uint8_t> samples;          // [row][cell][sample][channel][64]
    AlignedVector<std::uint8_t> bandwidth_scale;  // [row][cell][channel][64], 256 / bandwidth in grey levels
    AlignedVector<std::uint8_t> reference;        // [row][cell][channel][64], mean of the background
    AlignedVector<float> log_peak;                // [row][cell][64], log of the density's highest value
    // Something new that may become background: its colour and for how many visits it has stayed.
    AlignedVector<std::uint8_t> candidate;         // [row][cell][channel][64]
    AlignedVector<std::uint8_t> candidate_visits;  // [row][cell][64]

    int stride() const { return cells_per_row * kde::kCellPixels; }
    std::size_t cell_index(int row, int cell) const {
        return static_cast<std::size_t>(row) * cells_per_row + cell;
    }
    std::size_t cell_bytes() const { return static_cast<std::size_t>(channels) * kde::kCellPixels; }
    std::uint8_t* cell_samples(int row, int cell) {
        return samples.data() + cell_index(row, cell) * sample_count * cell_bytes();
    }
    const std::uint8_t* cell_scale(int row, int cell) const {
        return bandwidth_scale.data() + cell_index(row, cell) * cell_bytes();
    }
    const std::uint8_t* cell_reference(int row, int cell) const {
        return reference.data() + cell_index(row, cell) * cell_bytes();
    }
};

// Throws std::invalid_argument for an image that does not match a model of this size.
void check_image(const ImageView& image, int width, int height, int channels);

// 256 / bandwidth as it is stored.
std::uint8_t scale_of_bandwidth(float bandwidth);

// Logarithms of the 256 bandwidth scales as factors of a density; the first is 0.
const std::array<float, 256>& log_scales();
// Recomputes log_peak of one cell from its bandwidths.
void update_log_peak(BackgroundModel& model, std::size_t cell);

// What the update needs to know of the frame. `cells` and `density` hold the values of row `y`.
struct ModelUpdate {
    const std::uint8_t* cells = nullptr;    // [row][cell][channel][64]
    const std::uint8_t* density = nullptr;  // [row][cell][64]
    const std::uint8_t* keep_out =
        nullptr;             // the subject and its margin, non-zero: never learned; width bytes a row
    std::int64_t visit = 0;  // how often this row was visited before
};

class PackedSamples;

kde::UpdateParameters update_parameters(const SegmentationOptions& options, std::int64_t visit);

// Takes a frame's row into the model: background pixels into a slot of the short-term memory (the last
// quarter of the samples) and now and then of the long-term memory; anything else that stays the same for
// long enough replaces the whole short-term memory. `packed` follows.
void update_row(BackgroundModel& model, PackedSamples& packed, int y, const ModelUpdate& update,
                const SegmentationOptions& options);

BackgroundModel learn_background(std::span<const ImageView> empty_scene, int width, int height, int channels,
                                 const SegmentationOptions& options);

// The gain that best maps the model's reference to the image: the median of the ratios of a grid of pixels,
// then the mean of those near it, so that neither a person nor a lamp moves it.
GainBgr estimate_gain(const BackgroundModel& model, const ImageView& image);

// The bin that has half of the histogram's total below or in it; 0 if it is empty.
int median_bin(std::span<const int> histogram);

std::array<std::uint16_t, 3> fixed_point_inverse(const GainBgr& gain);

}  // namespace kinevox::kernels::cpu
