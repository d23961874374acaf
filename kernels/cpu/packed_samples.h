// The background samples in 4 bits each, if a cell's noise permits: the sums over them are memory-bound, so
// that half the bytes take nearly half the time. Lossless; the sums are the same.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/cpu/aligned_vector.h"
#include "kernels/cpu/segmentation_density.h"
#include "kernels/cpu/segmentation_model.h"

namespace kinevox::kernels::cpu {

// Follows a model; different cells may be written at once.
class PackedSamples {
  public:
    // Packs all cells of the model.
    void build(const BackgroundModel& model);

    // The cell's samples changed, in any slot.
    void pack(const BackgroundModel& model, std::size_t cell);
    // They changed in this slot alone.
    void replace(const BackgroundModel& model, std::size_t cell, int slot);

    // [channel][64] lowest values, then [pair of samples][channel][64], the first of a pair in the lower four
    // bits: a sample is its half byte above the lowest value. Null where a pixel's samples spread over more
    // than 16 levels.
    const std::uint8_t* cell(std::size_t cell) const {
        return narrow_[cell] ? data_.data() + cell * cell_bytes_ : nullptr;
    }

  private:
    AlignedVector<std::uint8_t> data_;  // [row][cell]
    std::vector<std::uint8_t> narrow_;  // [row][cell], whether it holds the samples
    std::size_t cell_bytes_ = 0;
};

}  // namespace kinevox::kernels::cpu
