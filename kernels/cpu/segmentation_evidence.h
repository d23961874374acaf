// The loops over the cells that are not plainly background: kde_evidence.h for 64 pixels at a time, and the
// smoothing of the result. Compiled for each processor family where Highway is there.
#pragma once

#include <cstdint>

#include "kernels/shared/kde_evidence.h"

namespace kinevox::kernels::cpu {

struct EvidenceCell {
    const std::uint8_t* value = nullptr;      // [channel][64]
    const std::uint8_t* reference = nullptr;  // [channel][64]
    const std::uint8_t* scale = nullptr;      // [channel][64]
    const std::uint8_t* density = nullptr;    // [64]
    const float* log_peak = nullptr;          // [64]
    int channels = 3;
};

// Row pointers at the cell's first pixel; each 64 floats.
struct LightRows {
    float* weighted_value = nullptr;
    float* weighted_energy = nullptr;
    float* factor = nullptr;
    float* residual = nullptr;
};

void fit_light_cell(const EvidenceCell& cell, const kde::EvidenceParameters& parameters,
                    const LightRows& out);

// `light` points into planes of `stride` floats a row that have kde::kLightReach rows and columns around the
// cell. log_lit: 256 entries, log_foreground: one entry a histogram bin.
void evidence_cell(const EvidenceCell& cell, const kde::EvidenceParameters& parameters,
                   const LightRows& light, std::ptrdiff_t stride, const float* log_lit,
                   const float* log_foreground, float* evidence);

// Five taps across rows: out[x] = sum w[i] * rows[i][x], then five along the row, for x in [0, width); `rows`
// and the result have two columns of margin.
void smooth_row(const float* const rows[5], const float weights[5], int width, float* scratch, float* out);

// What the pixels of a row become: their probability from a table of 256 steps of the evidence from -limit to
// limit, and 255 where the evidence is above a threshold.
struct Decision {
    const std::uint8_t* probability_of = nullptr;
    float limit = 0, sharp = 0, loose = 0;
};
void decide_row(const float* evidence, int width, const Decision& decision, std::uint8_t* probability,
                std::uint8_t* sharp, std::uint8_t* loose);

}  // namespace kinevox::kernels::cpu
