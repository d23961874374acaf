// From the image to the evidence of each pixel.
#include <algorithm>
#include <bit>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/rows_around.h"
#include "kernels/cpu/segmenter.h"

namespace kinevox::kernels::cpu {

using kde::kActiveMargin;
using kde::kCellPixels;
using kde::kGroupPixels;
using kde::kNeutralMargin;

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
    parallel_for(
        box.y0 - kNeutralMargin, box.y1 + kNeutralMargin, kSegmenterRowsPerTask, [&](int first, int last) {
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
    for_rows_around(active_span_, box, kde::kLightRadius, kSegmenterRowsPerTask,
                    [&](int y, int x, int count) {
                        neighbourhood_light(weighted_value_.row(y) + x, weighted_energy_.row(y) + x,
                                            neighbourhood_.stride, count, neighbourhood_.row(y) + x);
                    });
}

void CpuSegmenter::evidence(const CellBox& box) {
    colours_.log_density(options_.colour_memory_weight, log_foreground_);
    parallel_for(box.y0, box.y1, kSegmenterRowsPerTask, [&](int first, int last) {
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

}  // namespace kinevox::kernels::cpu
