// From the evidence to the silhouettes, and what they teach the models.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/segmenter.h"

namespace kinevox::kernels::cpu {
namespace {

constexpr int kBorderMargin = kde::kBorderRadius + kde::kBorderDepth;  // px that the refinement reads
constexpr float kSmoothing_px = 1.0f;                                  // sigma of the evidence filter
constexpr float kColourMemory = 0.9f;  // forgetting factor of the subject's colours per frame
constexpr float kSureEvidence = 3.0f;  // nats, from which a pixel's colour is taken for the subject's

}  // namespace

using kde::kCellPixels;
using kde::kGroupPixels;

// Smooths the evidence and decides each pixel; outside the spans the masks stay 0.
void CpuSegmenter::threshold(const CellBox& box, Silhouettes& out) {
    float weights[5], sum = 0;
    for (int i = 0; i < 5; ++i)
        sum += weights[i] =
            std::exp(-0.5f * static_cast<float>((i - 2) * (i - 2)) / (kSmoothing_px * kSmoothing_px));
    for (float& weight : weights) weight /= sum;
    const auto log_odds = [](float probability) { return std::log(probability / (1 - probability)); };
    const Decision decision{probability_of_, parameters_.limit, log_odds(options_.sharp_threshold),
                            log_odds(options_.loose_threshold)};
    parallel_for(box.y0, box.y1, kSegmenterRowsPerTask, [&](int first, int last) {
        std::vector<float> scratch((box.k1 - box.k0) * kCellPixels + 4);
        for (int y = first; y < last; ++y) {
            const GroupSpan span = active_span_[y];
            if (span.empty()) continue;
            const int x0 = span.g0 * kGroupPixels, pixels = (span.g1 - span.g0) * kGroupPixels;
            const float* rows[5];
            for (int i = 0; i < 5; ++i) rows[i] = evidence_.row(y + i - 2) + x0;
            smooth_row(rows, weights, pixels, scratch.data(), smoothed_.row(y) + x0);
            const std::size_t at = static_cast<std::size_t>(y) * width_ + x0;
            decide_row(smoothed_.row(y) + x0, std::min(pixels, width_ - x0), decision,
                       out.probability.data() + at, out.sharp.data() + at, out.loose.data() + at);
        }
    });
}

// Cleans the masks and refines the sharp one; returns the box that holds all that is set.
Rect CpuSegmenter::silhouettes(const Rect& active, const Rect& work, const SegmentationPrior& prior,
                               Silhouettes& out) {
    const MaskImage sharp_mask{out.sharp.data(), width_, height_},
        loose_mask{out.loose.data(), width_, height_};
    const std::uint8_t* seed = prior.region.empty() ? nullptr : prior.expected;
    Rect box = active;
    const auto clean = [&](const MaskImage& mask) {
        const auto largest = static_cast<float>(remove_small_components(
            mask, box, options_.min_component_px, options_.min_component_fraction, seed, components_));
        if (&mask == &loose_mask) {
            // The components of the sharp mask lie inside those of the loose one.
            Rect found{width_, height_, 0, 0};
            for (const Component& c : components_.components)
                found = {std::min(found.x0, c.bounds.x0), std::min(found.y0, c.bounds.y0),
                         std::max(found.x1, c.bounds.x1), std::max(found.y1, c.bounds.y1)};
            const Rect around = grown(found, kBorderMargin, width_, height_);
            box = {std::max(box.x0, around.x0), std::max(box.y0, around.y0), std::min(box.x1, around.x1),
                   std::min(box.y1, around.y1)};
        }
        fill_holes(mask, box,
                   std::max(options_.max_hole_px, static_cast<int>(options_.max_hole_fraction * largest)),
                   components_);
    };
    clean(loose_mask);
    if (box.empty()) return {};
    clean(sharp_mask);
    if (options_.colour_memory_weight > 0) learn_colours(box, out);
    if (options_.refine_border) {
        border_.refine(sharp_mask, box, work, model_, cells_.data(), {});
        remove_small_components(sharp_mask, box, options_.min_component_px / 3, 0, nullptr, components_);
    }
    for (int y = box.y0; y < box.y1; ++y)
        for_each_run(sharp_mask.row(y), box.x0, box.x1,
                     [&](int x0, int x1) { std::memset(loose_mask.row(y) + x0, 255, x1 - x0); });
    return box;
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

void CpuSegmenter::update_model(const ImageView& image, const SegmentationPrior& prior,
                                const Silhouettes& out) {
    if (options_.update_interval == 0) return;
    const int interval = options_.update_interval;
    const int phase = static_cast<int>(frame_ % interval);
    const std::int64_t visit = frame_ / interval;
    const bool tracked = !prior.region.empty();
    constexpr int kMargin = 3;
    parallel_for(0, (height_ - phase + interval - 1) / interval, 4, [&](int first, int last) {
        for (int n = first; n < last; ++n) {
            const int y = phase + n * interval;
            density_rows(image, y, y + 1, 0, model_.cells_per_row, false);
            // The subject, with a margin, is never learned. Other foreground has a low density: it is learned
            // only after it has stayed long enough.
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
            update_row(model_, packed_, y, {cells_.data(), density_.data(), keep_out_.data(), visit},
                       options_);
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

// Elsewhere the planes are 0 already.
void CpuSegmenter::clear(Silhouettes& out) const {
    const std::size_t pixels = static_cast<std::size_t>(width_) * height_;
    const bool reused = out.width == width_ && out.height == height_;
    const auto clear_plane = [&](std::vector<std::uint8_t>& plane, const Rect& dirty) {
        if (!reused || plane.size() != pixels) return plane.assign(pixels, 0);
        for (int y = dirty.y0; y < dirty.y1; ++y)
            std::memset(plane.data() + static_cast<std::size_t>(y) * width_ + dirty.x0, 0, dirty.width());
    };
    clear_plane(out.probability, out.searched);
    clear_plane(out.sharp, out.bounds);
    clear_plane(out.loose, out.bounds);
}

}  // namespace kinevox::kernels::cpu
