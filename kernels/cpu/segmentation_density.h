// The two loops that touch every pixel, in SIMD where Highway is there.
#pragma once

#include <cstdint>

#include "kernels/shared/kde_density.h"

namespace kinevox::kernels::cpu {

// Tables for a model of `sample_count` samples.
kde::DensityTables make_density_tables(int sample_count);

// Splits `pixels` (1..64) interleaved pixels into the planes of a cell, [channel][64], each channel
// multiplied by gain_64 / 16384 and rounded; the rest of the cell becomes 0. Values from 253 up are white and
// stay so: the sensor has clipped them.
void split_cell(const std::uint8_t* interleaved, int pixels, int channels, const std::uint16_t* gain_64,
                std::uint8_t* cell);

// kde::density() of the 64 pixels of a cell. With `may_stop` it ends, and returns true, as soon as fewer than
// kde::kCandidatesPerCell pixels are below kde::kSureDensity: plainly background, the sums are then lower
// bounds.
bool cell_density(const kde::DensityTables& tables, const std::uint8_t* cell, const std::uint8_t* samples,
                  const std::uint8_t* bandwidth_scale, int sample_count, int channels, bool may_stop,
                  std::uint8_t* density);

}  // namespace kinevox::kernels::cpu
