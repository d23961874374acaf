#include "kernels/cpu/shadow.h"

#include <algorithm>
#include <array>
#include <bit>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/shadow_group.h"
#include "kernels/shared/kde_density.h"

namespace kinevox::kernels::cpu {
namespace {

using kde::kCellPixels;
using kde::kGroupPixels;
using kde::kPatchRadius;

constexpr int kRowsPerTask = 16;
static_assert(kRowsPerTask % kde::kFloorBlock_px == 0);  // a block is looked up by one task

}  // namespace

void ShadowJudge::set_camera(const CameraModel& camera) {
    camera_ = make_projector(camera, "shadow");
    directions_ = floor_directions(camera);
}

void ShadowJudge::measure_patches(const CellBox& box, std::span<const GroupSpan> active_span,
                                  const ShadowPlanes& planes, int channels) const {
    const auto span_of = [&](int y) { return y < box.y0 || y >= box.y1 ? GroupSpan{} : active_span[y]; };
    parallel_for(box.y0 - kPatchRadius, box.y1 + kPatchRadius, kRowsPerTask, [&](int first, int last) {
        for (int y = first; y < last; ++y) {
            GroupSpan span;
            for (const int dy : {-kPatchRadius, 0, kPatchRadius}) span.include(span_of(y + dy));
            if (span.empty()) continue;
            const int x1 = span.g1 * kGroupPixels + kPatchRadius;
            for (int x = span.g0 * kGroupPixels - kPatchRadius; x < x1; x += kMaxRowPixels)
                misfit_row(planes.product->row(y) + x, planes.energy->row(y) + x, planes.square->row(y) + x,
                           planes.product->stride, std::min(x1 - x, kMaxRowPixels), channels,
                           planes.misfit->row(y) + x);
        }
    });
}

// The lights that other cameras see at the floor points of a row of blocks, looked up once per block.
struct ShadowJudge::FloorLights {
    struct Block {
        int row = -1;
        std::array<float, kde::kMaxFloorViews> light;  // per other camera
    };
    kde::FloorGrid grid;
    const Projector* camera = nullptr;
    std::span<const kde::SceneView* const> others;
    std::vector<Block> blocks;

    template <int kChannels>
    std::span<const float> at(int x, int y, const kde::EvidenceParameters& parameters) {
        Block& block = blocks[x / kde::kFloorBlock_px];
        const std::span<const float> lights(block.light.data(), others.size());
        if (block.row == y / kde::kFloorBlock_px) return lights;
        block.row = y / kde::kFloorBlock_px;
        float floor_x, floor_y;
        const bool floor =
            kde::floor_point(grid, *camera, kde::block_centre(x), kde::block_centre(y), floor_x, floor_y);
        for (std::size_t n = 0; n < others.size(); ++n)
            block.light[n] =
                floor ? kde::light_of_floor<kChannels>(*others[n], floor_x, floor_y, parameters) : -1;
        return lights;
    }
};

template <int kChannels>
void ShadowJudge::judge_row(int y, const GroupSpan& span, const ShadowPlanes& planes,
                            const BackgroundModel& model, const kde::EvidenceParameters& parameters,
                            FloorLights& floor) const {
    float* evidence = planes.evidence->row(y);
    ShadowGroup group;
    group.with_features = static_cast<bool>(observer_);
    group.view_count = static_cast<int>(floor.others.size());
    for (int g = span.g0; g < span.g1; ++g) {
        const int x0 = g * kGroupPixels, k = x0 / kCellPixels, first = x0 - k * kCellPixels;
        const std::size_t cell = model.cell_index(y, k);
        if (!(planes.active[cell] >> first / kGroupPixels & 1)) continue;
        const std::uint8_t* density = planes.density + cell * kCellPixels + first;
        const std::uint8_t* values = planes.cells + cell * model.cell_bytes() + first;
        unsigned doubtful = doubtful_pixels(density, evidence + x0);
        if (x0 + kGroupPixels > model.width) doubtful &= (1u << (model.width - x0)) - 1;
        if (doubtful == 0) continue;
        for (int i = 0; i < kGroupPixels; i += kde::kFloorBlock_px) {
            const bool asked = doubtful >> i & ((1u << kde::kFloorBlock_px) - 1);
            const auto lights = asked ? floor.at<kChannels>(x0 + i, y, parameters) : std::span<const float>();
            for (int n = 0; n < group.view_count; ++n)
                std::fill_n(group.floor_light[n] + i, kde::kFloorBlock_px, asked ? lights[n] : -1.0f);
        }
        for (int i = 0; i < kGroupPixels; ++i)
            group.log_foreground[i] = planes.log_foreground[kde::histogram_bin<kChannels>(values + i)];
        group.evidence = evidence + x0;
        group.pixels = {planes.factor->row(y) + x0, planes.residual->row(y) + x0,
                        planes.neighbourhood->row(y) + x0, planes.misfit->row(y) + x0, planes.factor->stride};
        shadow_group(kChannels, values, model.cell_reference(y, k) + first, model.cell_scale(y, k) + first,
                     parameters, group);
        for (unsigned left = doubtful; left != 0; left &= left - 1) {
            const int i = std::countr_zero(left);
            if (observer_) {
                float features[kde::kShadowFeatures];
                for (int n = 0; n < kde::kShadowFeatures; ++n) features[n] = group.features[n][i];
                observer_(x0 + i, y, features, evidence[x0 + i]);
            }
            evidence[x0 + i] = group.log_odds[i];
        }
    }
}

void ShadowJudge::judge(const CellBox& box, std::span<const GroupSpan> active_span,
                        const ShadowPlanes& planes, const BackgroundModel& model,
                        const kde::EvidenceParameters& parameters,
                        std::span<const kde::SceneView* const> others) const {
    const int first_task = box.y0 / kRowsPerTask, last_task = (box.y1 + kRowsPerTask - 1) / kRowsPerTask;
    parallel_for(first_task, last_task, 1, [&](int task, int) {
        FloorLights floor;
        floor.grid = {directions_.xy.data(),
                      directions_.columns,
                      {directions_.centre[0], directions_.centre[1], directions_.centre[2]}};
        floor.camera = &camera_;
        floor.others = others;
        floor.blocks.resize(model.width / kde::kFloorBlock_px + 1);
        for (int y = std::max(task * kRowsPerTask, box.y0); y < std::min((task + 1) * kRowsPerTask, box.y1);
             ++y) {
            if (active_span[y].empty()) continue;
            if (model.channels == 1)
                judge_row<1>(y, active_span[y], planes, model, parameters, floor);
            else
                judge_row<3>(y, active_span[y], planes, model, parameters, floor);
        }
    });
}

}  // namespace kinevox::kernels::cpu
