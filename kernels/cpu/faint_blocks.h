// Finds blocks that differ faintly from the background (shared/kde_faint.h).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "kernels/cpu/aligned_vector.h"
#include "kernels/cpu/segmentation_model.h"
#include "kernels/cpu/segmentation_search.h"
#include "kernels/shared/kde_faint.h"

namespace kinevox::kernels::cpu {

// The kde::kFaintBlocks blocks of a cell over kFaintBlock_px rows, [channel][64] bytes each; `value_stride`
// and `model_stride`: bytes between the rows of `value`, and of `reference` and `scale`.
void block_differences(const std::uint8_t* value, std::ptrdiff_t value_stride, const std::uint8_t* reference,
                       const std::uint8_t* scale, std::ptrdiff_t model_stride, int channels,
                       kde::BlockDifference* out);

class FaintBlocks {
  public:
    // The usual difference of the image's blocks from the background.
    kde::BlockDifference measure(const BackgroundModel& model, const ImageView& image,
                                 std::span<const std::uint16_t, 3> inverse_gain);
    // Finds them in the cells of `box` whose rows are all searched; elsewhere there are none. `cells`: the
    // image's values, `searched`: per cell.
    void find(const BackgroundModel& model, const std::uint8_t* cells, const std::uint8_t* searched,
              const CellBox& box, const kde::BlockDifference& usual);
    // Of the row's blocks in the cell, as bits from the left; 0 before find().
    unsigned in_cell(int y, int k) const {
        return blocks_.empty() ? 0u
                               : blocks_[static_cast<std::size_t>(y / kde::kFaintBlock_px) * columns_ + k];
    }
    // The density of the pixels of group g of a row, 0 in faint blocks: `density` itself, or a copy in
    // `scratch`.
    const std::uint8_t* unsure_in_group(int y, int g, const std::uint8_t* density,
                                        std::uint8_t* scratch) const;

  private:
    std::vector<std::uint16_t> blocks_;  // [row of blocks][cell]
    int columns_ = 0;
    AlignedVector<std::uint8_t> values_;  // scratch of measure()
};

}  // namespace kinevox::kernels::cpu
