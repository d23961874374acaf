#include "kernels/segmentation.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>
#include <utility>

#include "kernels/cpu/faint_blocks.h"
#include "kernels/cpu/foreground_colours.h"
#include "kernels/cpu/packed_samples.h"
#include "kernels/cpu/parallel.h"
#include "kernels/cpu/scene_lookup.h"
#include "kernels/cpu/segmentation_density.h"
#include "kernels/cpu/segmentation_evidence.h"
#include "kernels/cpu/segmentation_masks.h"
#include "kernels/cpu/segmentation_model.h"
#include "kernels/cpu/segmentation_search.h"
#include "kernels/cpu/shadow_training.h"
#include "kernels/segmentation_memory.h"
#include "kernels/shared/faint_weights.h"
#include "kernels/shared/kde_evidence.h"

namespace kinevox::kernels {
namespace cpu {
namespace {

using kde::kActiveMargin;
using kde::kCellPixels;
using kde::kGroupPixels;
using kde::kNeutralMargin;

constexpr int kRowsPerTask = 16;
constexpr int kBorderMargin = kde::kBorderRadius + kde::kBorderDepth;  // px that the refinement reads
constexpr float kSmoothing_px = 1.0f;                                  // sigma of the evidence filter
constexpr float kColourMemory = 0.9f;  // forgetting factor of the subject's colours per frame
constexpr float kSureEvidence = 3.0f;  // nats, from which a pixel's colour is taken for the subject's

class CpuSegmenter final : public RewindableSegmenter {
  public:
    CpuSegmenter(int width, int height, int channels, const SegmentationOptions& options);
    void learn(std::span<const ImageView> empty_scene) override;
    bool learned() const override { return learned_; }
    void set_judge_faint(bool judge) override;
    void keep_learned() override { keep_learned_ = true; }
    void forget_frames() override;
    void set_camera(const CameraModel& camera) override;
    void begin_frame(const ImageView& image, const SegmentationPrior& prior) override;
    void decide(std::span<const Segmenter* const> others, Silhouettes& out) override;
    void end_frame(const Silhouettes& out) override;
    const kde::SceneView* scene() const override { return has_camera_ ? &scene_ : nullptr; }
    void observe(ShadowJudge::Observer observer) { shadows_.set_observer(std::move(observer)); }

  private:
    void begin();
    void clear(Silhouettes& out) const;
    CellSamples samples_of(int y, int k);
    SamplesAhead samples_ahead(int y, int k);
    void prefetch(const std::uint8_t* cell) const;
    void density_rows(const ImageView& image, int y0, int y1, int k0, int k1, bool searched);
    CellBox find_active(const CellBox& work);
    void fit_light(const CellBox& active);
    void light_around(const CellBox& active);
    void evidence(const CellBox& active);
    void vote(const CellBox& active);
    void judge_shadows(const CellBox& active, std::span<const Segmenter* const> others);
    void threshold(const CellBox& active, Silhouettes& out);
    Rect silhouettes(const Rect& active, const Rect& work, const SegmentationPrior& prior, Silhouettes& out);
    void learn_colours(const Rect& box, const Silhouettes& out);
    void update_model(const ImageView& image, const SegmentationPrior& prior, const Silhouettes& out);
    void measure(const Rect& box, Silhouettes& out) const;
    EvidenceCell cell_at(int y, int k) const;

    int width_, height_, channels_;
    SegmentationOptions options_;
    kde::DensityTables tables_;
    kde::EvidenceParameters parameters_;
    float log_lit_[256];
    std::uint8_t probability_of_[256];  // of evidence in steps of limit / 128
    bool learned_ = false, keep_learned_ = false;
    std::int64_t frame_ = 0;
    BackgroundModel model_, learned_model_;  // the latter empty unless it is kept
    PackedSamples packed_;
    std::array<std::uint16_t, 3> inverse_gain_{};
    AlignedVector<std::uint8_t> cells_, density_;
    std::vector<std::uint8_t>
        candidates_;                    // per cell, the groups near its unsure pixels; 0: plainly background
    std::vector<std::uint8_t> active_;  // per cell, the groups that are looked at
    std::vector<std::uint8_t> searched_;  // per cell, whether its density is this frame's
    std::vector<std::uint8_t> spread_;    // scratch of find_active
    std::vector<GroupSpan> active_span_;  // per row, from the first active group to the last
    std::vector<std::uint8_t> lit_;     // per cell, the groups for which the planes hold values of their own
    std::vector<std::uint8_t> looked_;  // per cell, samples that are in its density
    Plane weighted_value_, weighted_energy_, factor_, residual_, neighbourhood_, evidence_, smoothed_;
    Plane product_, energy_, square_, misfit_, distance_, colour_, voted_;  // see ShadowPlanes
    ShadowJudge shadows_;
    FaintBlocks faint_;               // none unless options_.judge_faint
    float noise_factor_ = 1;          // of the image, with options_.judge_faint
    std::vector<std::int8_t> votes_;  // see kde::SceneView
    bool has_camera_ = false;
    kde::SceneView scene_;
    // The frame between begin_frame() and end_frame().
    ImageView image_;
    SegmentationPrior prior_;
    CellBox work_, active_box_;
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
    set_judge_faint(options.judge_faint);
    for (int i = 0; i < 256; ++i)
        log_lit_[i] =
            std::log(std::max(i, 1) / 255.0f * static_cast<float>(kde::saturation(options.samples)));
    for (int i = 0; i < 256; ++i) {
        const float evidence = (static_cast<float>(i) - 127.5f) / 127.5f * parameters_.limit;
        probability_of_[i] = static_cast<std::uint8_t>(std::lround(255.0f / (1.0f + std::exp(-evidence))));
    }
}

void CpuSegmenter::set_judge_faint(bool judge) {
    if (options_.judge_faint && !judge) {
        faint_ = {};
        noise_factor_ = 1;
    }
    options_.judge_faint = judge;
    parameters_.shadow = judge ? kde::kFaintRule : kde::ShadowRule{};
}

void CpuSegmenter::learn(std::span<const ImageView> empty_scene) {
    if (empty_scene.empty())
        throw std::invalid_argument("segmentation: the background needs at least one image");
    for (const ImageView& image : empty_scene) check_image(image, width_, height_, channels_);
    model_ = learn_background(empty_scene, width_, height_, channels_, options_);
    if (keep_learned_) learned_model_ = model_;
    begin();
}

void CpuSegmenter::forget_frames() {
    if (!learned_ || !keep_learned_)
        throw std::logic_error(
            "segmentation: no learned background was kept; call keep_learned() before learn()");
    model_ = learned_model_;
    begin();
}

// The first frame is still to come.
void CpuSegmenter::begin() {
    packed_.build(model_);
    const std::size_t cells = model_.cell_index(height_, 0);
    cells_.assign(cells * model_.cell_bytes(), 0);
    density_.assign(cells * kCellPixels, 255);
    candidates_.assign(cells, 0);
    active_.assign(cells, 0);
    searched_.assign(cells, 0);
    active_span_.assign(height_, {});
    lit_.assign(cells, 0);
    looked_.assign(cells, kde::kSamplesPerLook);
    for (Plane* plane : {&weighted_value_, &weighted_energy_, &factor_, &residual_, &neighbourhood_,
                         &product_, &energy_, &square_, &misfit_, &distance_, &colour_, &voted_})
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
SamplesAhead CpuSegmenter::samples_ahead(int y, int k) {
    const std::size_t cell = model_.cell_index(y, k);
    const std::uint8_t* packed = packed_.cell(cell);
    if (!packed) return {model_.cell_samples(y, k), looked_[cell]};
    return {packed, 1 + (looked_[cell] + 1) / 2};
}

CellSamples CpuSegmenter::samples_of(int y, int k) {
    return {model_.cell_samples(y, k), packed_.cell(model_.cell_index(y, k)), model_.sample_count};
}

// As much as a cell holds. The processor foresees no step to the next row.
void CpuSegmenter::prefetch(const std::uint8_t* cell) const {
    for (int c = 0; c < channels_; ++c) __builtin_prefetch(cell + c * kCellPixels);
}

// The density of the cells of rows [y0, y1) that are searched in this frame, or of those that are not.
void CpuSegmenter::density_rows(const ImageView& image, int y0, int y1, int k0, int k1, bool searched) {
    const auto next = [&](int& y, int& k) {
        for (++k; y < y1; ++y, k = k0)
            for (; k < k1; ++k)
                if ((searched_[model_.cell_index(y, k)] != 0) == searched) return;
    };
    int y = y0, k = k0 - 1;
    next(y, k);
    while (y < y1) {
        const std::size_t cell = model_.cell_index(y, k);
        const int x = k * kCellPixels;
        std::uint8_t* values = cells_.data() + cell * model_.cell_bytes();
        std::uint8_t* density = density_.data() + cell * kCellPixels;
        split_cell(image.row(y) + x * channels_, std::min(kCellPixels, width_ - x), channels_,
                   inverse_gain_.data(), values);
        const int this_y = y, this_k = k;
        next(y, k);
        const SamplesAhead ahead = y < y1 ? samples_ahead(y, k) : SamplesAhead{};
        if (y < y1) {
            prefetch(image.row(y) + static_cast<std::ptrdiff_t>(k) * kCellPixels * channels_);
            prefetch(model_.cell_scale(y, k));
        }
        const DensityLooks looks =
            cell_density(tables_, values, samples_of(this_y, this_k), model_.cell_scale(this_y, this_k),
                         channels_, 0, true, density, ahead);
        candidates_[cell] = looks.plain ? 0 : groups_near_unsure(density);
        looked_[cell] = static_cast<std::uint8_t>(looks.samples);
    }
}

// Marks the searched cells' groups near unsure pixels, and the span of each row that they take; returns the
// box around them.
CellBox CpuSegmenter::find_active(const CellBox& work) {
    CellBox box{work.y1, work.y0, work.k1, work.k0};
    std::fill(active_span_.begin(), active_span_.end(), GroupSpan{});
    const int columns = work.k1 - work.k0, rows = work.y1 - work.y0;
    spread_.assign(static_cast<std::size_t>(rows + 2 * kActiveMargin) * columns, 0);
    for (int y = 0; y < rows; ++y) {
        const std::size_t first = model_.cell_index(work.y0 + y, work.k0);
        std::uint8_t* row = spread_.data() + static_cast<std::size_t>(y + kActiveMargin) * columns;
        for (int k = 0; k < columns; ++k) {
            if (!searched_[first + k]) continue;
            row[k] = candidates_[first + k];
            if (const unsigned faint = faint_.in_cell(work.y0 + y, work.k0 + k))
                row[k] |= static_cast<std::uint8_t>(kde::groups_near(static_cast<int>(faint)));
        }
    }
    // Each row takes in more and more of those below it.
    for (int covered = 1, window = 2 * kActiveMargin + 1; covered < window;) {
        const int step = std::min(covered, window - covered);
        const std::size_t below = static_cast<std::size_t>(step) * columns;
        for (std::size_t i = 0; i + below < spread_.size(); ++i) spread_[i] |= spread_[i + below];
        covered += step;
    }
    for (int y = work.y0; y < work.y1; ++y) {
        const std::uint8_t* near = spread_.data() + static_cast<std::size_t>(y - work.y0) * columns - work.k0;
        std::uint8_t* active = active_.data() + model_.cell_index(y, 0);
        const std::uint8_t* searched = searched_.data() + model_.cell_index(y, 0);
        for (int k = work.k0; k < work.k1; ++k) {
            int groups = near[k] & kde::kAllGroups;
            if (k > work.k0 && near[k - 1] & kde::kNearRight) groups |= 1;
            if (k + 1 < work.k1 && near[k + 1] & kde::kNearLeft) groups |= kde::kLastGroup;
            active[k] = static_cast<std::uint8_t>(searched[k] ? groups : 0);
            if (!active[k]) continue;
            active_span_[y].include(groups_of_cell(k, active[k]));
            box = {std::min(box.y0, y), y + 1, std::min(box.k0, k), std::max(box.k1, k + 1)};
        }
    }
    return box;
}

void CpuSegmenter::fit_light(const CellBox& box) {
    // A ring of rows and a cell around the box is read by the neighbourhoods and holds neutral values.
    parallel_for(box.y0 - kNeutralMargin, box.y1 + kNeutralMargin, kRowsPerTask, [&](int first, int last) {
        for (int y = std::max(first, 0); y < std::min(last, height_); ++y)
            for (int k = std::max(box.k0 - 1, 0); k < std::min(box.k1 + 1, model_.cells_per_row); ++k) {
                const std::ptrdiff_t x = static_cast<std::ptrdiff_t>(k) * kCellPixels;
                const bool inside = y >= box.y0 && y < box.y1 && k >= box.k0 && k < box.k1;
                const std::size_t cell = model_.cell_index(y, k);
                const int active = inside ? active_[cell] : 0;
                for (unsigned left = lit_[cell] & ~static_cast<unsigned>(active); left != 0;
                     left &= left - 1) {
                    const std::ptrdiff_t at =
                        x + static_cast<std::ptrdiff_t>(std::countr_zero(left)) * kGroupPixels;
                    std::fill_n(weighted_value_.row(y) + at, kGroupPixels, 0.0f);
                    std::fill_n(weighted_energy_.row(y) + at, kGroupPixels, 0.0f);
                    for (Plane* plane : {&product_, &energy_, &square_})
                        std::fill_n(plane->row(y) + at, kGroupPixels, 0.0f);
                    std::fill_n(evidence_.row(y) + at, kGroupPixels, -parameters_.limit);
                }
                lit_[cell] = static_cast<std::uint8_t>(active);
                if (!active) continue;
                if (!candidates_[cell])  // its sums ended early
                    cell_density(tables_, cells_.data() + cell * model_.cell_bytes(), samples_of(y, k),
                                 model_.cell_scale(y, k), channels_, looked_[cell], false,
                                 density_.data() + cell * kCellPixels);
                fit_light_cell(
                    cell_at(y, k), active, parameters_,
                    {weighted_value_.row(y) + x, weighted_energy_.row(y) + x, factor_.row(y) + x,
                     residual_.row(y) + x, product_.row(y) + x, energy_.row(y) + x, square_.row(y) + x});
            }
    });
}

// The light of the neighbourhoods around, above, below and beside the active groups' pixels.
void CpuSegmenter::light_around(const CellBox& box) {
    constexpr int kRadius = kde::kLightRadius;
    const auto span_of = [&](int y) { return y < box.y0 || y >= box.y1 ? GroupSpan{} : active_span_[y]; };
    parallel_for(box.y0 - kRadius, box.y1 + kRadius, kRowsPerTask, [&](int first, int last) {
        for (int y = first; y < last; ++y) {
            GroupSpan span;
            for (const int dy : {-kRadius, 0, kRadius}) span.include(span_of(y + dy));
            if (span.empty()) continue;
            const int x1 = span.g1 * kGroupPixels + kRadius;
            for (int x = span.g0 * kGroupPixels - kRadius; x < x1; x += kMaxRowPixels)
                neighbourhood_light(weighted_value_.row(y) + x, weighted_energy_.row(y) + x,
                                    neighbourhood_.stride, std::min(x1 - x, kMaxRowPixels),
                                    neighbourhood_.row(y) + x);
        }
    });
}

void CpuSegmenter::evidence(const CellBox& box) {
    colours_.log_density(options_.colour_memory_weight, log_foreground_);
    parallel_for(box.y0, box.y1, kRowsPerTask, [&](int first, int last) {
        for (int y = first; y < last; ++y)
            for (int k = box.k0; k < box.k1; ++k) {
                const int active = active_[model_.cell_index(y, k)];
                if (!active) continue;
                const std::ptrdiff_t x = static_cast<std::ptrdiff_t>(k) * kCellPixels;
                evidence_cell(cell_at(y, k), active, parameters_,
                              {factor_.row(y) + x, residual_.row(y) + x, neighbourhood_.row(y) + x,
                               neighbourhood_.stride},
                              log_lit_, log_foreground_.data(),
                              {evidence_.row(y) + x, distance_.row(y) + x, colour_.row(y) + x});
            }
    });
}

// Counts the blocks' votes and finds the bounds of what is plainly the subject.
void CpuSegmenter::vote(const CellBox& box) {
    constexpr int kBlock = kde::kVoteBlock_px;
    const int columns = scene_.vote_columns;
    std::fill(votes_.begin(), votes_.end(), static_cast<std::int8_t>(-kde::kMaxVote));
    scene_.sees = false;
    if (box.empty()) return;
    Rect subject{columns, height_, 0, 0};  // blocks
    std::vector<std::int8_t> sums(static_cast<std::size_t>(box.k1) * kCellPixels);
    for (int row = box.y0 / kBlock; row * kBlock < box.y1; ++row) {
        GroupSpan span;
        std::fill(sums.begin(), sums.end(), static_cast<std::int8_t>(-kBlock));
        for (int y = row * kBlock; y < std::min((row + 1) * kBlock, height_); ++y) {
            if (y < box.y0 || y >= box.y1) continue;
            span.include(active_span_[y]);
            for (int g = active_span_[y].g0; g < active_span_[y].g1; ++g) {
                const int x0 = g * kGroupPixels, k = x0 / kCellPixels, first = x0 - k * kCellPixels;
                const std::size_t cell = model_.cell_index(y, k);
                if (!(active_[cell] >> first / kGroupPixels & 1)) continue;
                std::uint8_t scratch[kGroupPixels];
                const std::uint8_t* density =
                    faint_.unsure_in_group(y, g, density_.data() + cell * kCellPixels + first, scratch);
                const float* evidence = evidence_.row(y) + x0;
                std::int8_t* sum = sums.data() + x0;
                const int pixels = std::min(kGroupPixels, width_ - x0);
#pragma GCC ivdep
                for (int i = 0; i < pixels; ++i)
                    sum[i] = static_cast<std::int8_t>(sum[i] + 1 + kde::pixel_vote(density[i], evidence[i]));
            }
        }
        std::int8_t* votes = votes_.data() + static_cast<std::ptrdiff_t>(row) * columns;
        const int last = std::min(span.g1 * (kGroupPixels / kBlock), columns);
        for (int column = span.g0 * (kGroupPixels / kBlock); column < last; ++column) {
            const std::int8_t* sum = sums.data() + static_cast<std::ptrdiff_t>(column) * kBlock;
            const int votes_here = sum[0] + sum[1] + sum[2] + sum[3];
            votes[column] = static_cast<std::int8_t>(votes_here);
            if (votes_here < kde::kSubjectVote) continue;
            subject = {std::min(subject.x0, column), std::min(subject.y0, row),
                       std::max(subject.x1, column + 1), row + 1};
        }
    }
    if (subject.empty()) return;
    scene_.sees = true;
    shadows_.bounds_of({subject.x0 * kBlock, subject.y0 * kBlock, subject.x1 * kBlock, subject.y1 * kBlock},
                       scene_.bounds);
}

void CpuSegmenter::judge_shadows(const CellBox& box, std::span<const Segmenter* const> others) {
    const ShadowPlanes planes{
        &factor_,   &residual_,      &neighbourhood_, &product_,     &energy_,
        &square_,   &misfit_,        &distance_,      &colour_,      &voted_,
        &evidence_, density_.data(), active_.data(),  votes_.data(), scene_.vote_columns,
        &faint_,    noise_factor_};
    std::vector<const kde::SceneView*> scenes;
    for (const Segmenter* other : others)
        if (other != this && other->scene() && other->scene()->channels == channels_ &&
            scenes.size() < kde::kMaxFloorViews)
            scenes.push_back(other->scene());
    if (!has_camera_ || scenes.empty()) return;  // the rule needs a second view of the floor
    shadows_.judge(box, active_span_, planes, model_, parameters_, scenes);
}

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
    parallel_for(box.y0, box.y1, kRowsPerTask, [&](int first, int last) {
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

void CpuSegmenter::set_camera(const CameraModel& camera) {
    scene_.camera = make_projector(camera, "segmentation");
    shadows_.set_camera(camera);
    scene_.vote_columns = (width_ + kde::kVoteBlock_px - 1) / kde::kVoteBlock_px;
    votes_.assign(static_cast<std::size_t>(scene_.vote_columns) *
                          ((height_ + kde::kVoteBlock_px - 1) / kde::kVoteBlock_px) +
                      kVotePadding,
                  0);
    scene_.votes = votes_.data();
    has_camera_ = true;
}

void CpuSegmenter::begin_frame(const ImageView& image, const SegmentationPrior& prior) {
    if (!learned_) throw std::logic_error("segmentation: learn() the background before segmenting");
    check_image(image, width_, height_, channels_);
    image_ = image;
    prior_ = prior;
    Rect asked{0, 0, width_, height_};
    if (!prior.full_pass && !prior.region.empty()) {
        const Rect& r = prior.region;
        asked = {std::max(r.x0, 0), std::max(r.y0, 0), std::min(r.x1, width_), std::min(r.y1, height_)};
        if (asked.empty()) asked = {};
    }
    work_ = {asked.y0, asked.y1, asked.x0 / kCellPixels, (asked.x1 + kCellPixels - 1) / kCellPixels};
    mark_searched(prior, work_, width_, height_, searched_.data());
    inverse_gain_ = fixed_point_inverse(estimate_gain(model_, image));
    scene_.image = image.data;
    scene_.image_stride = image.stride;
    scene_.reference = model_.reference.data();
    scene_.scale = model_.bandwidth_scale.data();
    std::copy(inverse_gain_.begin(), inverse_gain_.end(), scene_.inverse_gain);
    scene_.channels = channels_;
    scene_.cells_per_row = model_.cells_per_row;
    parallel_for(work_.y0, work_.y1, kRowsPerTask,
                 [&](int first, int last) { density_rows(image, first, last, work_.k0, work_.k1, true); });
    if (options_.judge_faint) {
        const kde::BlockDifference usual = faint_.measure(model_, image, inverse_gain_);
        noise_factor_ = kde::noise_factor(usual, channels_, parameters_.noise_fraction);
        faint_.find(model_, cells_.data(), searched_.data(), work_, usual);
    }
    active_box_ = find_active(work_);
    if (!active_box_.empty()) {
        fit_light(active_box_);
        light_around(active_box_);
        evidence(active_box_);
    }
    if (has_camera_) vote(active_box_);
}

void CpuSegmenter::decide(std::span<const Segmenter* const> others, Silhouettes& out) {
    clear(out);
    out.width = width_, out.height = height_;
    out.searched = {work_.k0 * kCellPixels, work_.y0, std::min(work_.k1 * kCellPixels, width_), work_.y1};
    if (active_box_.empty()) return measure({}, out);
    judge_shadows(active_box_, others);
    threshold(active_box_, out);
    const Rect box{active_box_.k0 * kCellPixels, active_box_.y0,
                   std::min(active_box_.k1 * kCellPixels, width_), active_box_.y1};
    measure(silhouettes(box, out.searched, prior_, out), out);
}

void CpuSegmenter::end_frame(const Silhouettes& out) {
    update_model(image_, prior_, out);
    ++frame_;
}

}  // namespace

void observe_shadows(Segmenter& segmenter, ShadowJudge::Observer observer) {
    auto* const cpu = dynamic_cast<CpuSegmenter*>(&segmenter);
    if (!cpu) throw std::invalid_argument("shadow observer: not a segmenter of the CPU");
    cpu->observe(std::move(observer));
}

}  // namespace cpu

std::unique_ptr<Segmenter> make_segmenter_cpu(int width, int height, int channels,
                                              const SegmentationOptions& options) {
    return std::make_unique<cpu::CpuSegmenter>(width, height, channels, options);
}

}  // namespace kinevox::kernels
