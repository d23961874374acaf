// The two loops over every pixel, with SIMD if Highway is available.
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

// kde::density() of the 64 pixels of a cell. Adds the samples from `begin` (a multiple of
// kde::kSamplesPerLook) to `density`, which is cleared first if `begin` is 0. With `may_stop` it ends as soon
// as fewer than kde::kCandidatesPerCell pixels are below kde::kSureDensity: clearly background, the sums are
// lower bounds. Returns the number of samples in the sums, and whether it ended early.
struct DensityLooks {
    int samples = 0;
    bool plain = false;
};
// A cell's samples.
struct CellSamples {
    const std::uint8_t* whole = nullptr;   // [sample][channel][64]
    const std::uint8_t* packed = nullptr;  // the same samples as PackedSamples keeps them, or null
    int count = 0;
};
// Data of the next cell to prefetch, since loading a cell takes longer than its sums: `lines` groups of
// [channel][64] bytes.
struct SamplesAhead {
    const std::uint8_t* first = nullptr;
    int lines = 0;
};
DensityLooks cell_density(const kde::DensityTables& tables, const std::uint8_t* cell,
                          const CellSamples& samples, const std::uint8_t* bandwidth_scale, int channels,
                          int begin, bool may_stop, std::uint8_t* density, const SamplesAhead& ahead = {});

}  // namespace kinevox::kernels::cpu
