#include "kernels/segmentation.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

#include "kernels/cpu/foreground_colours.h"
#include "kernels/cpu/parallel.h"
#include "kernels/cpu/segmentation_density.h"
#include "kernels/cpu/segmentation_evidence.h"
#include "kernels/cpu/segmentation_masks.h"
#include "kernels/cpu/segmentation_model.h"
#include "kernels/cuda/forms.h"

namespace kinevox::kernels {
namespace cpu {
namespace {

using kde::kCellPixels;

constexpr int kRowsPerTask = 16;
constexpr int kActiveMargin = 4;  // rows around candidates that are looked at: light's reach + smoothing's
constexpr int kPlaneMargin = 8;   // rows above and below the planes of evidence
constexpr float kSmoothing_px = 1.0f;  // of the evidence, one standard deviation
constexpr float kColourMemory = 0.9f;  // of the subject's colours from frame to frame
constexpr float kSureEvidence = 3.0f;  // nats, from which a pixel's colour is taken for the subject's

// A plane of floats with a cell of margin at both sides and rows above and below, so that no loop asks where
// the picture ends.
struct Plane {
    std::vector<float> data;
    std::ptrdiff_t stride = 0;
    void resize(int cells_per_row, int height, float value) {
        stride = static_cast<std::ptrdiff_t>(cells_per_row + 2) * kCellPixels;
        data.assign(static_cast<std::size_t>(stride) * (height + 2 * kPlaneMargin), value);
    }
    float* row(int y) { return data.data() + (y + kPlaneMargin) * stride + kCellPixels; }
};

// Rows [y0, y1) of cells [k0, k1).
struct CellBox {
    int y0 = 0, y1 = 0, k0 = 0, k1 = 0;
    bool empty() const { return y1 <= y0 || k1 <= k0; }
};

class CpuSegmenter final : public Segmenter {
  public:
    CpuSegmenter(int width, int height, int channels, const SegmentationOptions& options);
    void learn(std::span<const PictureView> empty_scene) override;
    bool learned() const override { return learned_; }
    void segment(const PictureView& picture, const SegmentationPrior& prior, Silhouettes& out) override;

  private:
    void check_picture(const PictureView& picture) const;
    SamplesAhead samples_of(int y, int k);
    void density_rows(const PictureView& picture, int y0, int y1, int k0, int k1);
    CellBox find_active(const CellBox& work);
    void evidence(const CellBox& active);
    void smooth(const CellBox& active);
    void silhouettes(const Rect& box, const Rect& work, const SegmentationPrior& prior, Silhouettes& out);
    void learn_colours(const Rect& box, const Silhouettes& out);
    void update_model(const PictureView& picture, const SegmentationPrior& prior, const CellBox& work,
                      const Silhouettes& out);
    void measure(const Rect& box, Silhouettes& out) const;
    EvidenceCell cell_at(int y, int k) const;

    int width_, height_, channels_;
    SegmentationOptions options_;
    kde::DensityTables tables_;
    kde::EvidenceParameters parameters_;
    float log_lit_[256];
    std::uint8_t probability_of_[256];  // of evidence in steps of limit / 128
    bool learned_ = false;
    std::int64_t frame_ = 0;
    BackgroundModel model_;
    std::array<std::uint16_t, 3> inverse_gain_{};
    AlignedVector<std::uint8_t> cells_, density_;
    std::vector<std::uint8_t> candidates_, active_;  // per cell
    std::vector<std::uint8_t> neutral_;  // per cell, whether the planes hold what is read beside evidence
    std::vector<std::uint8_t> looked_;   // per cell, samples that are in its density
    Plane weighted_value_, weighted_energy_, factor_, residual_, evidence_, smoothed_;
    ForegroundColours colours_;
    std::vector<float> log_foreground_;
    std::vector<std::int32_t> colour_counts_;
    std::vector<std::uint8_t> keep_out_;
    RunComponents components_;
    BorderRefiner border_;
};

CpuSegmenter::CpuSegmenter(int width, int height, int channels, const SegmentationOptions& options)
    : width_(width),
      height_(height),
      channels_(channels),
      options_(options),
      tables_(make_density_tables(options.samples)),
      colours_(channels) {
    parameters_.darkest = options.darkest_shadow;
    parameters_.brightest = options.brightest_light;
    parameters_.log_prior_light = std::log(options.light_change_prior);
    for (int i = 0; i < 256; ++i)
        log_lit_[i] =
            std::log(std::max(i, 1) / 255.0f * static_cast<float>(kde::saturation(options.samples)));
    for (int i = 0; i < 256; ++i) {
        const float evidence = (static_cast<float>(i) - 127.5f) / 127.5f * parameters_.limit;
        probability_of_[i] = static_cast<std::uint8_t>(std::lround(255.0f / (1.0f + std::exp(-evidence))));
    }
}

void CpuSegmenter::check_picture(const PictureView& picture) const {
    if (picture.data && picture.width == width_ && picture.height == height_ && picture.channels == channels_)
        return;
    throw std::invalid_argument("segmentation: a picture of " + std::to_string(picture.width) + " x " +
                                std::to_string(picture.height) + " with " + std::to_string(picture.channels) +
                                " channels came to a model of " + std::to_string(width_) + " x " +
                                std::to_string(height_) + " with " + std::to_string(channels_) +
                                "; learn the background from this camera's pictures");
}

void CpuSegmenter::learn(std::span<const PictureView> empty_scene) {
    if (empty_scene.empty())
        throw std::invalid_argument("segmentation: the background needs at least one picture");
    for (const PictureView& picture : empty_scene) check_picture(picture);
    model_ = learn_background(empty_scene, width_, height_, channels_, options_);
    const std::size_t cells = model_.cell_index(height_, 0);
    cells_.assign(cells * model_.cell_bytes(), 0);
    density_.assign(cells * kCellPixels, 255);
    candidates_.assign(cells, 0);
    active_.assign(cells, 0);
    neutral_.assign(cells, 1);
    looked_.assign(cells, kde::kSamplesPerLook);
    for (Plane* plane : {&weighted_value_, &weighted_energy_, &factor_, &residual_})
        plane->resize(model_.cells_per_row, height_, 0);
    for (Plane* plane : {&evidence_, &smoothed_})
        plane->resize(model_.cells_per_row, height_, -parameters_.limit);
    keep_out_.assign(static_cast<std::size_t>(width_) * height_, 0);
    colours_.clear();
    frame_ = 0;
    learned_ = true;
}

EvidenceCell CpuSegmenter::cell_at(int y, int k) const {
    const std::size_t cell = model_.cell_index(y, k);
    return {cells_.data() + cell * model_.cell_bytes(),
            model_.cell_reference(y, k),
            model_.cell_scale(y, k),
            density_.data() + cell * kCellPixels,
            model_.log_peak.data() + cell * kCellPixels,
            channels_};
}

// What a cell's density needed last time, and so most likely needs again.
SamplesAhead CpuSegmenter::samples_of(int y, int k) {
    return {model_.cell_samples(y, k), looked_[model_.cell_index(y, k)]};
}

void CpuSegmenter::density_rows(const PictureView& picture, int y0, int y1, int k0, int k1) {
    for (int y = y0; y < y1; ++y)
        for (int k = k0; k < k1; ++k) {
            const std::size_t cell = model_.cell_index(y, k);
            const int x = k * kCellPixels;
            std::uint8_t* values = cells_.data() + cell * model_.cell_bytes();
            std::uint8_t* density = density_.data() + cell * kCellPixels;
            split_cell(picture.row(y) + x * channels_, std::min(kCellPixels, width_ - x), channels_,
                       inverse_gain_.data(), values);
            SamplesAhead ahead;
            if (k + 1 < k1)
                ahead = samples_of(y, k + 1);
            else if (y + 1 < y1)
                ahead = samples_of(y + 1, k0);
            const DensityLooks looks =
                cell_density(tables_, values, model_.cell_samples(y, k), model_.cell_scale(y, k),
                             model_.sample_count, channels_, 0, true, density, ahead);
            candidates_[cell] = !looks.plain;
            looked_[cell] = static_cast<std::uint8_t>(looks.samples);
        }
}

// Marks the cells of `work` near candidates and returns the box around them.
CellBox CpuSegmenter::find_active(const CellBox& work) {
    CellBox box{work.y1, work.y0, work.k1, work.k0};
    for (int y = work.y0; y < work.y1; ++y)
        std::memset(active_.data() + model_.cell_index(y, work.k0), 0, work.k1 - work.k0);
    for (int y = work.y0; y < work.y1; ++y)
        for (int k = work.k0; k < work.k1; ++k) {
            const std::size_t cell = model_.cell_index(y, k);
            if (!candidates_[cell]) continue;
            const std::uint8_t* density = density_.data() + cell * kCellPixels;
            const auto near = [&](int first) {
                return std::any_of(density + first, density + first + kActiveMargin,
                                   [](std::uint8_t d) { return d < kde::kSureDensity; });
            };
            const int y0 = std::max(y - kActiveMargin, work.y0),
                      y1 = std::min(y + kActiveMargin + 1, work.y1);
            const int k0 = near(0) ? std::max(k - 1, work.k0) : k;
            const int k1 = near(kCellPixels - kActiveMargin) ? std::min(k + 2, work.k1) : k + 1;
            for (int ay = y0; ay < y1; ++ay)
                for (int ak = k0; ak < k1; ++ak) active_[model_.cell_index(ay, ak)] = 1;
            box = {std::min(box.y0, y0), std::max(box.y1, y1), std::min(box.k0, k0), std::max(box.k1, k1)};
        }
    return box;
}

void CpuSegmenter::evidence(const CellBox& box) {
    // A ring of two rows and a cell around the box is read by the neighbourhoods and holds neutral values.
    parallel_for(box.y0 - kActiveMargin, box.y1 + kActiveMargin, kRowsPerTask, [&](int first, int last) {
        for (int y = first; y < last; ++y)
            for (int k = box.k0 - 1; k < box.k1 + 1; ++k) {
                const std::ptrdiff_t x = static_cast<std::ptrdiff_t>(k) * kCellPixels;
                if (y < 0 || y >= height_ || k < 0 || k >= model_.cells_per_row)
                    continue;  // margins: neutral for ever
                const bool inside = y >= box.y0 && y < box.y1 && k >= box.k0 && k < box.k1;
                const std::size_t cell = model_.cell_index(y, k);
                if (inside && active_[cell]) {
                    neutral_[cell] = 0;
                    if (!candidates_[cell])  // its sums ended early
                        cell_density(tables_, cells_.data() + cell * model_.cell_bytes(),
                                     model_.cell_samples(y, k), model_.cell_scale(y, k), model_.sample_count,
                                     channels_, looked_[cell], false, density_.data() + cell * kCellPixels);
                    fit_light_cell(cell_at(y, k), parameters_,
                                   {weighted_value_.row(y) + x, weighted_energy_.row(y) + x,
                                    factor_.row(y) + x, residual_.row(y) + x});
                } else if (!neutral_[cell]) {
                    neutral_[cell] = 1;
                    std::fill_n(weighted_value_.row(y) + x, kCellPixels, 0.0f);
                    std::fill_n(weighted_energy_.row(y) + x, kCellPixels, 0.0f);
                    std::fill_n(evidence_.row(y) + x, kCellPixels, -parameters_.limit);
                }
            }
    });
    colours_.log_density(options_.colour_memory_share, log_foreground_);
    parallel_for(box.y0, box.y1, kRowsPerTask, [&](int first, int last) {
        for (int y = first; y < last; ++y)
            for (int k = box.k0; k < box.k1; ++k) {
                if (!active_[model_.cell_index(y, k)]) continue;
                const std::ptrdiff_t x = static_cast<std::ptrdiff_t>(k) * kCellPixels;
                evidence_cell(cell_at(y, k), parameters_,
                              {weighted_value_.row(y) + x, weighted_energy_.row(y) + x, factor_.row(y) + x,
                               residual_.row(y) + x},
                              evidence_.stride, log_lit_, log_foreground_.data(), evidence_.row(y) + x);
            }
    });
}

void CpuSegmenter::smooth(const CellBox& box) {
    float weights[5], sum = 0;
    for (int i = 0; i < 5; ++i)
        sum += weights[i] =
            std::exp(-0.5f * static_cast<float>((i - 2) * (i - 2)) / (kSmoothing_px * kSmoothing_px));
    for (float& weight : weights) weight /= sum;
    const int x0 = box.k0 * kCellPixels, pixels = (box.k1 - box.k0) * kCellPixels;
    parallel_for(box.y0, box.y1, kRowsPerTask, [&](int first, int last) {
        std::vector<float> scratch(pixels + 4);
        for (int y = first; y < last; ++y) {
            const float* rows[5];
            for (int i = 0; i < 5; ++i) rows[i] = evidence_.row(y + i - 2) + x0;
            smooth_row(rows, weights, pixels, scratch.data(), smoothed_.row(y) + x0);
        }
    });
}

void CpuSegmenter::silhouettes(const Rect& box, const Rect& work, const SegmentationPrior& prior,
                               Silhouettes& out) {
    const auto log_odds = [](float probability) { return std::log(probability / (1 - probability)); };
    const Decision decision{probability_of_, parameters_.limit, log_odds(options_.sharp_threshold),
                            log_odds(options_.loose_threshold)};
    parallel_for(box.y0, box.y1, kRowsPerTask, [&](int first, int last) {
        for (int y = first; y < last; ++y) {
            const std::size_t at = static_cast<std::size_t>(y) * width_ + box.x0;
            decide_row(smoothed_.row(y) + box.x0, box.width(), decision, out.probability.data() + at,
                       out.sharp.data() + at, out.loose.data() + at);
        }
    });
    const MaskPicture sharp_mask{out.sharp.data(), width_, height_},
        loose_mask{out.loose.data(), width_, height_};
    const std::uint8_t* seed = prior.region.empty() ? nullptr : prior.expected;
    const auto clean = [&](const MaskPicture& mask) {
        const auto largest = static_cast<float>(
            drop_islands(mask, box, options_.min_island_px, options_.min_island_part, seed, components_));
        fill_holes(mask, box,
                   std::max(options_.max_hole_px, static_cast<int>(options_.max_hole_part * largest)),
                   components_);
    };
    clean(loose_mask);
    clean(sharp_mask);
    if (options_.colour_memory_share > 0) learn_colours(box, out);
    if (options_.refine_border) {
        border_.refine(sharp_mask, box, work, model_, cells_.data(), {});
        drop_islands(sharp_mask, box, options_.min_island_px / 3, 0, nullptr, components_);
    }
    for (int y = box.y0; y < box.y1; ++y)
        for_each_run(sharp_mask.row(y), box.x0, box.x1,
                     [&](int x0, int x1) { std::memset(loose_mask.row(y) + x0, 255, x1 - x0); });
}

void CpuSegmenter::learn_colours(const Rect& box, const Silhouettes& out) {
    constexpr int kDepth = 2;
    colour_counts_.assign(colours_.bins(), 0);
    for (int y = std::max(box.y0, kDepth); y < std::min(box.y1, height_ - kDepth); ++y) {
        const std::uint8_t* row = out.sharp.data() + static_cast<std::size_t>(y) * width_;
        const float* evidence = smoothed_.row(y);
        for_each_run(row, std::max(box.x0, kDepth), std::min(box.x1, width_ - kDepth), [&](int x0, int x1) {
            for (int x = x0; x < x1; ++x) {
                if (!(row[x - kDepth] && row[x + kDepth] && row[x - kDepth * width_] &&
                      row[x + kDepth * width_]) ||
                    evidence[x] < kSureEvidence)
                    continue;
                const std::uint8_t* value = cells_.data() +
                                            model_.cell_index(y, x / kCellPixels) * model_.cell_bytes() +
                                            x % kCellPixels;
                ++colour_counts_[channels_ == 1 ? kde::histogram_bin<1>(value)
                                                : kde::histogram_bin<3>(value)];
            }
        });
    }
    colours_.add(colour_counts_, kColourMemory);
}

void CpuSegmenter::update_model(const PictureView& picture, const SegmentationPrior& prior,
                                const CellBox& work, const Silhouettes& out) {
    if (options_.update_interval == 0) return;
    const int interval = options_.update_interval;
    const int phase = static_cast<int>(frame_ % interval);
    const std::int64_t visit = frame_ / interval;
    const bool tracked = !prior.region.empty();
    constexpr int kMargin = 3;
    parallel_for(0, (height_ - phase + interval - 1) / interval, 4, [&](int first, int last) {
        for (int n = first; n < last; ++n) {
            const int y = phase + n * interval;
            if (y < work.y0 || y >= work.y1) {
                density_rows(picture, y, y + 1, 0, model_.cells_per_row);
            } else {
                density_rows(picture, y, y + 1, 0, work.k0);
                density_rows(picture, y, y + 1, work.k1, model_.cells_per_row);
            }
            // The subject, with a margin, is never learned. Other foreground is told by its density: it is
            // not learned until it has stayed for long.
            std::uint8_t* keep_out = keep_out_.data() + static_cast<std::size_t>(y) * width_;
            std::memset(keep_out, 0, width_);
            if (tracked)
                for (int dy = -kMargin; dy <= kMargin; dy += kMargin) {
                    const std::size_t row =
                        static_cast<std::size_t>(std::clamp(y + dy, 0, height_ - 1)) * width_;
                    const auto keep = [&](int x0, int x1) {
                        x0 = std::max(x0 - kMargin, 0), x1 = std::min(x1 + kMargin, width_);
                        std::memset(keep_out + x0, 255, x1 - x0);
                    };
                    for_each_run(out.loose.data() + row, 0, width_, keep);
                    if (prior.expected) for_each_run(prior.expected + row, 0, width_, keep);
                }
            update_row(model_, y, {cells_.data(), density_.data(), keep_out_.data(), visit}, options_);
        }
    });
}

void CpuSegmenter::measure(const Rect& box, Silhouettes& out) const {
    std::int64_t sum_x = 0, sum_y = 0, count = 0;
    Rect bounds{width_, height_, 0, 0};
    for (int y = box.y0; y < box.y1; ++y) {
        const std::size_t row = static_cast<std::size_t>(y) * width_;
        std::int64_t in_row = 0;
        for_each_run(out.loose.data() + row, box.x0, box.x1, [&](int x0, int x1) {
            bounds = {std::min(bounds.x0, x0), std::min(bounds.y0, y), std::max(bounds.x1, x1), y + 1};
        });
        for_each_run(out.sharp.data() + row, box.x0, box.x1, [&](int x0, int x1) {
            in_row += x1 - x0;
            sum_x += std::int64_t{x1 - x0} * (x0 + x1 - 1) / 2;
        });
        count += in_row;
        sum_y += in_row * y;
    }
    out.bounds = bounds.empty() ? Rect{} : bounds;
    out.sharp_pixels = count;
    out.centroid_x = count > 0 ? static_cast<double>(sum_x) / static_cast<double>(count) : 0;
    out.centroid_y = count > 0 ? static_cast<double>(sum_y) / static_cast<double>(count) : 0;
}

void CpuSegmenter::segment(const PictureView& picture, const SegmentationPrior& prior, Silhouettes& out) {
    if (!learned_) throw std::logic_error("segmentation: learn() the background before segment()");
    check_picture(picture);
    const std::size_t pixels = static_cast<std::size_t>(width_) * height_;
    for (auto* plane : {&out.probability, &out.sharp, &out.loose}) plane->assign(pixels, 0);
    out.width = width_, out.height = height_;
    Rect asked{0, 0, width_, height_};
    if (!prior.full_pass && !prior.region.empty()) {
        const Rect& r = prior.region;
        asked = {std::max(r.x0, 0), std::max(r.y0, 0), std::min(r.x1, width_), std::min(r.y1, height_)};
        if (asked.empty()) asked = {};
    }
    const CellBox work{asked.y0, asked.y1, asked.x0 / kCellPixels,
                       (asked.x1 + kCellPixels - 1) / kCellPixels};
    out.searched = {work.k0 * kCellPixels, work.y0, std::min(work.k1 * kCellPixels, width_), work.y1};
    inverse_gain_ = fixed_point_inverse(estimate_gain(model_, picture));
    parallel_for(work.y0, work.y1, kRowsPerTask,
                 [&](int first, int last) { density_rows(picture, first, last, work.k0, work.k1); });
    const CellBox active = find_active(work);
    if (active.empty()) {
        measure({}, out);
    } else {
        evidence(active);
        smooth(active);
        const Rect box{active.k0 * kCellPixels, active.y0, std::min(active.k1 * kCellPixels, width_),
                       active.y1};
        silhouettes(box, out.searched, prior, out);
        measure(box, out);
    }
    update_model(picture, prior, work, out);
    ++frame_;
}

}  // namespace
}  // namespace cpu

std::unique_ptr<Segmenter> make_segmenter(Device device, int width, int height, int channels,
                                          const SegmentationOptions& options) {
    if (const std::string problem = options.check(); !problem.empty())
        throw std::invalid_argument("segmentation options: " + problem);
    if (width < 1 || height < 1 || (channels != 1 && channels != 3))
        throw std::invalid_argument("segmentation: pictures of " + std::to_string(width) + " x " +
                                    std::to_string(height) + " with " + std::to_string(channels) +
                                    " channels; sizes are positive and channels 1 or 3");
    if (device == Device::kCuda) {
#ifdef KINEVOX_HAVE_CUDA
        return make_segmenter_cuda(width, height, channels, options);
#else
        throw std::runtime_error(
            "segmentation: built without a CUDA compiler; build where nvcc is found, or use "
            "device cpu");
#endif
    }
    return std::make_unique<cpu::CpuSegmenter>(width, height, channels, options);
}

}  // namespace kinevox::kernels
