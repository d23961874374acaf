#include "kernels/cpu/faint_blocks.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "kernels/cpu/dispatch.h"
#include "kernels/cpu/parallel.h"
#include "kernels/cpu/segmentation_density.h"
#include "kernels/shared/kde_evidence.h"

// Compiled for each family that Highway chooses from at run time; the compiler vectorises the plain loops.
#ifdef KINEVOX_HAVE_HIGHWAY
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/cpu/faint_blocks.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
HWY_BEFORE_NAMESPACE();
#endif

namespace kinevox::kernels::cpu::HWY_NAMESPACE {

using kde::kCellPixels;

void block_differences(const std::uint8_t* value, std::ptrdiff_t value_stride, const std::uint8_t* reference,
                       const std::uint8_t* scale, std::ptrdiff_t model_stride, int channels,
                       kde::BlockDifference* out) {
    std::fill_n(out, kde::kFaintBlocks, kde::BlockDifference{});
    for (int c = 0; c < channels; ++c) {
        std::int32_t sums[kCellPixels] = {}, squares[kCellPixels] = {};
        for (int row = 0; row < kde::kFaintBlock_px; ++row) {
            const std::ptrdiff_t at = row * model_stride + c * kCellPixels;
            const std::uint8_t *v = value + row * value_stride + c * kCellPixels, *r = reference + at,
                               *s = scale + at;
#pragma GCC ivdep
            for (int x = 0; x < kCellPixels; ++x) {
                const int difference = kde::scaled_difference(v[x], r[x], s[x]);
                sums[x] += difference;
                squares[x] += difference * difference;
            }
        }
        for (int block = 0; block < kde::kFaintBlocks; ++block) {
            const std::int32_t *sum = sums + block * kde::kFaintBlock_px,
                               *square = squares + block * kde::kFaintBlock_px;
            kde::add_channel(out[block], sum[0] + sum[1] + sum[2] + sum[3],
                             square[0] + square[1] + square[2] + square[3]);
        }
    }
}

}  // namespace kinevox::kernels::cpu::HWY_NAMESPACE

#ifdef KINEVOX_HAVE_HIGHWAY
HWY_AFTER_NAMESPACE();
#endif

#if !defined(KINEVOX_HAVE_HIGHWAY) || HWY_ONCE
namespace kinevox::kernels::cpu {

KINEVOX_EXPORT(block_differences);

void block_differences(const std::uint8_t* value, std::ptrdiff_t value_stride, const std::uint8_t* reference,
                       const std::uint8_t* scale, std::ptrdiff_t model_stride, int channels,
                       kde::BlockDifference* out) {
    KINEVOX_DISPATCH(block_differences)(value, value_stride, reference, scale, model_stride, channels, out);
}

kde::BlockDifference FaintBlocks::measure(const BackgroundModel& model, const ImageView& image,
                                          std::span<const std::uint16_t, 3> inverse_gain) {
    constexpr int kRows = kde::kFaintBlock_px;
    const auto cell_bytes = static_cast<std::ptrdiff_t>(model.cell_bytes()),
               row_bytes = model.cells_per_row * cell_bytes;
    const int block_rows = model.height / kRows, columns = model.width / kRows;
    const int step = kde::noise_row_step(block_rows);
    std::array<int, kde::kNoiseBins> means{}, pixels{};
    values_.resize(kRows * cell_bytes);
    for (int row = step / 2; row < block_rows; row += step)
        for (int k = 0; k < model.cells_per_row; ++k) {
            const int x = k * kde::kCellPixels, y = row * kRows;
            for (int n = 0; n < kRows; ++n)
                split_cell(image.row(y + n) + x * model.channels, std::min(kde::kCellPixels, model.width - x),
                           model.channels, inverse_gain.data(), values_.data() + n * cell_bytes);
            kde::BlockDifference blocks[kde::kFaintBlocks];
            block_differences(values_.data(), cell_bytes, model.cell_reference(y, k), model.cell_scale(y, k),
                              row_bytes, model.channels, blocks);
            for (int n = 0; n < kde::kFaintBlocks && k * kde::kFaintBlocks + n < columns; ++n) {
                ++means[kde::noise_bin(blocks[n].mean, kde::kMeanBinShift)];
                ++pixels[kde::noise_bin(blocks[n].pixel, kde::kPixelBinShift)];
            }
        }
    return kde::usual_difference(median_bin(means), median_bin(pixels), model.channels);
}

const std::uint8_t* FaintBlocks::unsure_in_group(int y, int g, const std::uint8_t* density,
                                                 std::uint8_t* scratch) const {
    constexpr int kBlocks = kde::kGroupPixels / kde::kFaintBlock_px,
                  kGroups = kde::kCellPixels / kde::kGroupPixels;
    const unsigned faint = in_cell(y, g / kGroups) >> g % kGroups * kBlocks & ((1u << kBlocks) - 1);
    if (faint == 0) return density;
    std::memcpy(scratch, density, kde::kGroupPixels);
    for (unsigned left = faint; left != 0; left &= left - 1)
        std::memset(scratch + std::countr_zero(left) * kde::kFaintBlock_px, 0, kde::kFaintBlock_px);
    return scratch;
}

void FaintBlocks::find(const BackgroundModel& model, const std::uint8_t* cells, const std::uint8_t* searched,
                       const CellBox& box, const kde::BlockDifference& usual) {
    constexpr int kRows = kde::kFaintBlock_px;
    columns_ = model.cells_per_row;
    blocks_.assign(static_cast<std::size_t>((model.height + kRows - 1) / kRows) * columns_, 0);
    const auto row_bytes = static_cast<std::ptrdiff_t>(model.cells_per_row * model.cell_bytes());
    const int whole_blocks = model.width / kRows;
    parallel_for((box.y0 + kRows - 1) / kRows, box.y1 / kRows, 4, [&](int first, int last) {
        for (int row = first; row < last; ++row)
            for (int k = box.k0; k < box.k1; ++k) {
                const int y = row * kRows;
                bool whole = true;
                for (int n = 0; n < kRows; ++n) whole = whole && searched[model.cell_index(y + n, k)];
                if (!whole) continue;
                kde::BlockDifference blocks[kde::kFaintBlocks];
                const std::size_t at = model.cell_index(y, k) * model.cell_bytes();
                block_differences(cells + at, row_bytes, model.reference.data() + at,
                                  model.bandwidth_scale.data() + at, row_bytes, model.channels, blocks);
                unsigned bits = 0;
                for (int n = 0; n < kde::kFaintBlocks && k * kde::kFaintBlocks + n < whole_blocks; ++n)
                    bits |= kde::is_faint(blocks[n], usual) ? 1u << n : 0u;
                blocks_[static_cast<std::size_t>(row) * columns_ + k] = static_cast<std::uint16_t>(bits);
            }
    });
}

}  // namespace kinevox::kernels::cpu
#endif
