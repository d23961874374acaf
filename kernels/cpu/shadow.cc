#include "kernels/cpu/shadow.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/rows_around.h"
#include "kernels/cpu/scene_lookup.h"
#include "kernels/cpu/segmentation_masks.h"
#include "kernels/cpu/shadow_group.h"
#include "kernels/shared/kde_density.h"

namespace kinevox::kernels::cpu {
namespace {

using kde::kCellPixels;
using kde::kGroupPixels;
using kde::kPatchRadius;

constexpr int kRowsPerTask = 16;
constexpr std::size_t kHalves = kGroupPixels / kde::kSupportBlock_px;  // of a group
static_assert(kRowsPerTask % kde::kFloorBlock_px == 0);                // a block is looked up by one task
static_assert(kRowsPerTask % kde::kSupportBlock_px == 0);
static_assert(kRowsPerTask % kde::kVoteBlock_px == 0);

}  // namespace

void ShadowJudge::set_camera(const CameraModel& camera) {
    model_ = camera;
    camera_ = make_projector(camera, "shadow");
    directions_ = floor_directions(camera);
}

kde::FloorGrid ShadowJudge::grid() const {
    return {directions_.xy.data(),
            directions_.columns,
            {directions_.centre[0], directions_.centre[1], directions_.centre[2]}};
}

// The misfit of the patches that the rule reads, those of judged_span_ and around them.
void ShadowJudge::measure_patches(const CellBox& box, const ShadowPlanes& planes, int channels) const {
    for_rows_around(judged_span_, box, kPatchRadius, kRowsPerTask, [&](int y, int x, int count) {
        misfit_row(planes.product->row(y) + x, planes.energy->row(y) + x, planes.square->row(y) + x,
                   planes.product->stride, count, channels, planes.misfit->row(y) + x);
    });
}

// The lights that other cameras see at the floor points of a row of blocks.
struct ShadowJudge::FloorLights {
    kde::FloorGrid grid;
    const Projector* camera = nullptr;
    std::span<const kde::SceneView* const> others;
    std::array<std::vector<float>, kde::kMaxFloorViews> lights;  // of each other camera, per block
    std::vector<int> wanted;                                     // scratch

    // For the blocks of row `y` that hold `wanted`.
    void look_up(int y, const kde::EvidenceParameters& parameters) {
        constexpr int kBlock = kde::kFloorBlock_px;
        for (std::size_t first = 0; first < wanted.size(); first += kPointsPerLookup) {
            const int count =
                static_cast<int>(std::min<std::size_t>(kPointsPerLookup, wanted.size() - first));
            FloorPoints points{};
            unsigned floor = 0;
            for (int n = 0; n < count; ++n)
                if (kde::floor_point(grid, *camera, kde::block_centre<kBlock>(wanted[first + n] * kBlock),
                                     kde::block_centre<kBlock>(y), points.x[n], points.y[n]))
                    floor |= 1u << n;
            for (std::size_t view = 0; view < others.size(); ++view) {
                float light[kPointsPerLookup];
                lights_of_floor(*others[view], points, parameters, light);
                for (int n = 0; n < count; ++n)
                    lights[view][wanted[first + n]] = floor >> n & 1 ? light[n] : -1;
            }
        }
    }
};

// The support of a row of blocks, looked up once per block.
struct ShadowJudge::Supports {
    struct Block {
        int row = -1;
        float support = 0;
    };
    kde::FloorGrid grid;
    const Projector* camera = nullptr;
    std::span<const kde::SceneView* const> others;
    std::vector<Block> blocks;

    float at(int x, int y) {
        constexpr int kBlock = kde::kSupportBlock_px;
        Block& block = blocks[x / kBlock];
        if (block.row == y / kBlock) return block.support;
        block.row = y / kBlock;
        kde::SupportRay ray;
        const bool known =
            kde::support_ray(grid, *camera, kde::block_centre<kBlock>(x), kde::block_centre<kBlock>(y), ray);
        block.support = known ? support_of(ray, others) : kde::kUnknownSupport;
        return block.support;
    }
};

// Finds the pixels of a row that the rule decides. Those where the subject cannot be become background,
// unless they are lighter than any shadow.
void ShadowJudge::find_doubtful(int y, const GroupSpan& span, const ShadowPlanes& planes,
                                const BackgroundModel& model, float limit, Supports& supports) {
    constexpr int kVotes = kGroupPixels / kde::kVoteBlock_px, kHalf = kde::kSupportBlock_px;
    static_assert(kGroupPixels == 2 * kHalf && kVotes == 4);
    float* evidence = planes.evidence->row(y);
    const float* factor = planes.factor->row(y);
    const std::int8_t* votes =
        planes.votes + static_cast<std::ptrdiff_t>(y / kde::kVoteBlock_px) * planes.vote_columns;
    GroupSpan judged;
    for (int g = span.g0; g < span.g1; ++g) {
        const int x0 = g * kGroupPixels, k = x0 / kCellPixels, first = x0 - k * kCellPixels;
        const std::size_t cell = model.cell_index(y, k);
        std::uint16_t& kept = doubtful_[static_cast<std::size_t>(y) * groups_per_row_ + g];
        kept = 0;
        if (!(planes.active[cell] >> first / kGroupPixels & 1)) continue;
        unsigned wanted = 0;
        for (int n = 0; n < kVotes && g * kVotes + n < planes.vote_columns; ++n) {
            const int vote = votes[g * kVotes + n];
            if (vote >= kde::kMinJudgedVote && vote < kde::kMaxVote) wanted |= 15u << n * kde::kVoteBlock_px;
        }
        if (wanted == 0) continue;
        std::uint8_t scratch[kGroupPixels];
        const std::uint8_t* density =
            planes.faint->unsure_in_group(y, g, planes.density + cell * kCellPixels + first, scratch);
        unsigned doubtful = wanted & doubtful_pixels(density, evidence + x0);
        if (x0 + kGroupPixels > model.width) doubtful &= (1u << (model.width - x0)) - 1;
        for (int half = 0; half < 2; ++half) {
            const unsigned block = doubtful & 0xffu << half * kHalf;
            if (block == 0) continue;
            const float support = supports.at(x0 + half * kHalf, y);
            support_[kHalves * (static_cast<std::size_t>(y) * groups_per_row_ + g) + half] = support;
            if (support >= kde::kMinSupport) continue;
            for (unsigned left = block; left != 0; left &= left - 1) {
                const int i = std::countr_zero(left);
                if (kde::is_lighter(factor + x0 + i, planes.factor->stride)) continue;
                evidence[x0 + i] = -limit;
                doubtful &= ~(1u << i);
            }
        }
        kept = static_cast<std::uint16_t>(doubtful);
        if (doubtful != 0) judged.include({g, g + 1});
    }
    judged_span_[y] = judged;
}

// Looks up the floor's light for the blocks of rows [y0, y1), one row of blocks, with doubtful pixels.
void ShadowJudge::find_lights(int y0, int y1, const kde::EvidenceParameters& parameters,
                              FloorLights& floor) const {
    constexpr int kBlocks = kGroupPixels / kde::kFloorBlock_px;
    GroupSpan span;
    for (int y = y0; y < y1; ++y) span.include(judged_span_[y]);
    floor.wanted.clear();
    for (int g = span.g0; g < span.g1; ++g) {
        unsigned doubtful = 0;
        for (int y = y0; y < y1; ++y)
            if (g >= judged_span_[y].g0 && g < judged_span_[y].g1)
                doubtful |= doubtful_[static_cast<std::size_t>(y) * groups_per_row_ + g];
        for (int block = 0; block < kBlocks; ++block, doubtful >>= kde::kFloorBlock_px)
            if (doubtful & ((1u << kde::kFloorBlock_px) - 1)) floor.wanted.push_back(g * kBlocks + block);
    }
    floor.look_up(y0, parameters);
}

void ShadowJudge::judge_row(int y, const ShadowPlanes& planes, const kde::EvidenceParameters& parameters,
                            int channels, const FloorLights& floor) {
    float *evidence = planes.evidence->row(y), *voted = planes.voted->row(y);
    std::uint8_t* changed =
        changed_.data() + static_cast<std::size_t>(y / kde::kVoteBlock_px) * planes.vote_columns;
    ShadowGroup group;
    group.with_features = static_cast<bool>(observer_);
    group.view_count = static_cast<int>(floor.others.size());
    group.noise_factor = planes.noise_factor;
    for (int g = judged_span_[y].g0; g < judged_span_[y].g1; ++g) {
        const std::size_t at = static_cast<std::size_t>(y) * groups_per_row_ + g;
        const unsigned doubtful = doubtful_[at];
        if (doubtful == 0) continue;
        const int x0 = g * kGroupPixels;
        for (int n = 0; n < group.view_count; ++n)
            group.floor_light[n] = floor.lights[n].data() + x0 / kde::kFloorBlock_px;
        group.support = support_.data() + kHalves * at;
        group.pixels = {planes.factor->row(y) + x0, planes.residual->row(y) + x0,
                        planes.neighbourhood->row(y) + x0, planes.misfit->row(y) + x0, planes.factor->stride};
        group.distance = planes.distance->row(y) + x0;
        group.colour = planes.colour->row(y) + x0;
        shadow_group(channels, parameters.shadow, group);
        for (unsigned left = doubtful; left != 0; left &= left - 1) {
            const int i = std::countr_zero(left);
            if (observer_) {
                float features[kde::kShadowFeatures];
                for (int n = 0; n < kde::kShadowFeatures; ++n) features[n] = group.features[n][i];
                observer_(x0 + i, y, features, evidence[x0 + i]);
            }
            const kde::ShadowLogOdds<float> odds{group.own[i], group.voted[i]};
            evidence[x0 + i] = odds.own;
            voted[x0 + i] = odds.voted;
            changed[(x0 + i) / kde::kVoteBlock_px] += odds.changed();
        }
    }
}

// Takes the votes over where they change a limb's width of pixels, see kde::is_limb().
void ShadowJudge::add_votes(const CellBox& box, const ShadowPlanes& planes) {
    constexpr int kBlock = kde::kVoteBlock_px;
    const int columns = planes.vote_columns, rows = static_cast<int>(changed_.size()) / columns;
    Rect found{columns, rows, 0, 0};  // blocks with changed pixels
    for (int row = box.y0 / kBlock; row * kBlock < box.y1; ++row)
        for (int column = 0; column < columns; ++column)
            if (changed_[static_cast<std::size_t>(row) * columns + column] != 0)
                found = {std::min(found.x0, column), std::min(found.y0, row), std::max(found.x1, column + 1),
                         row + 1};
    if (found.empty()) return;
    const int subject = static_cast<int>(std::count_if(planes.votes, planes.votes + changed_.size(),
                                                       [](int vote) { return vote >= kde::kSubjectVote; }));
    const int radius = kde::voted_radius(subject);
    const Rect area = grown(found, radius, columns, rows);
    // Sums over all blocks above and to the left, with a row and a column of zeros before the first.
    const int width = area.width() + 1;
    sums_.assign(static_cast<std::size_t>(width) * (area.height() + 1), 0);
    const auto sum_at = [&](int row, int column) -> int& {
        return sums_[static_cast<std::size_t>(row - area.y0) * width + (column - area.x0)];
    };
    for (int row = area.y0; row < area.y1; ++row)
        for (int column = area.x0, in_row = 0; column < area.x1; ++column) {
            in_row += changed_[static_cast<std::size_t>(row) * columns + column];
            sum_at(row + 1, column + 1) = sum_at(row, column + 1) + in_row;
        }
    added_.assign(changed_.size(), 0);
    for (int row = area.y0; row < area.y1; ++row)
        for (int column = area.x0; column < area.x1; ++column) {
            const Rect square = grown({column, row, column + 1, row + 1}, radius, columns, rows);
            const int x0 = std::max(square.x0, area.x0), x1 = std::min(square.x1, area.x1),
                      y0 = std::max(square.y0, area.y0), y1 = std::min(square.y1, area.y1);
            if (!kde::is_limb(sum_at(y1, x1) - sum_at(y0, x1) - sum_at(y1, x0) + sum_at(y0, x0), radius))
                continue;
            for (int y = square.y0; y < square.y1; ++y)
                std::memset(added_.data() + static_cast<std::size_t>(y) * columns + square.x0, 1,
                            square.width());
        }
    for (int y = box.y0; y < box.y1; ++y) {
        float* evidence = planes.evidence->row(y);
        const float* voted = planes.voted->row(y);
        const std::uint8_t* added = added_.data() + static_cast<std::size_t>(y / kBlock) * columns;
        for (int g = judged_span_[y].g0; g < judged_span_[y].g1; ++g)
            for (unsigned left = doubtful_[static_cast<std::size_t>(y) * groups_per_row_ + g]; left != 0;
                 left &= left - 1) {
                const int x = g * kGroupPixels + std::countr_zero(left);
                if (added[x / kBlock] != 0) evidence[x] = std::max(evidence[x], voted[x]);
            }
    }
}

void ShadowJudge::judge(const CellBox& box, std::span<const GroupSpan> active_span,
                        const ShadowPlanes& planes, const BackgroundModel& model,
                        const kde::EvidenceParameters& parameters,
                        std::span<const kde::SceneView* const> others) {
    groups_per_row_ = model.cells_per_row * (kCellPixels / kGroupPixels);
    doubtful_.resize(active_span.size() * groups_per_row_);
    support_.resize(kHalves * doubtful_.size() + kBlockPadding);
    judged_span_.resize(active_span.size());
    constexpr int kBlock = kde::kVoteBlock_px;
    changed_.assign((active_span.size() + kBlock - 1) / kBlock * planes.vote_columns, 0);
    const int first_task = box.y0 / kRowsPerTask, last_task = (box.y1 + kRowsPerTask - 1) / kRowsPerTask;
    const auto rows = [&](int task, const auto& of_row) {
        for (int y = std::max(task * kRowsPerTask, box.y0); y < std::min((task + 1) * kRowsPerTask, box.y1);
             ++y)
            of_row(y);
    };
    parallel_for(first_task, last_task, 1, [&](int task, int) {
        Supports supports{grid(), &camera_, others, {}};
        supports.blocks.resize(model.width / kde::kSupportBlock_px + 1);
        rows(task,
             [&](int y) { find_doubtful(y, active_span[y], planes, model, parameters.limit, supports); });
    });
    measure_patches(box, planes, model.channels);
    parallel_for(first_task, last_task, 1, [&](int task, int) {
        FloorLights floor{grid(), &camera_, others, {}, {}};
        for (std::size_t n = 0; n < others.size(); ++n)
            floor.lights[n].resize(groups_per_row_ * (kGroupPixels / kde::kFloorBlock_px) + kBlockPadding);
        const int end = std::min((task + 1) * kRowsPerTask, box.y1);
        for (int y0 = std::max(task * kRowsPerTask, box.y0), y1; y0 < end; y0 = y1) {
            y1 = std::min((y0 / kde::kFloorBlock_px + 1) * kde::kFloorBlock_px, end);
            find_lights(y0, y1, parameters, floor);
            for (int y = y0; y < y1; ++y) judge_row(y, planes, parameters, model.channels, floor);
        }
    });
    add_votes(box, planes);
}

}  // namespace kinevox::kernels::cpu
