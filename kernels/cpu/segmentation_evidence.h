// The loops over the pixels that are not plainly background: kde_evidence.h for a cell's groups of 16, and
// the smoothing of the result. Compiled for each processor family where Highway is there.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "kernels/shared/kde_evidence.h"

namespace kinevox::kernels::cpu {

// A plane of floats with a margin of one cell at both sides and rows above and below, so that loops need no
// bounds checks.
struct Plane {
    static constexpr int kMarginRows = 8;
    std::vector<float> data;
    std::ptrdiff_t stride = 0;
    void resize(int cells_per_row, int height, float value) {
        stride = static_cast<std::ptrdiff_t>(cells_per_row + 2) * kde::kCellPixels;
        data.assign(static_cast<std::size_t>(stride) * (height + 2 * kMarginRows), value);
    }
    float* row(int y) { return data.data() + (y + kMarginRows) * stride + kde::kCellPixels; }
};

struct EvidenceCell {
    const std::uint8_t* value = nullptr;      // [channel][64]
    const std::uint8_t* reference = nullptr;  // [channel][64]
    const std::uint8_t* scale = nullptr;      // [channel][64]
    const std::uint8_t* density = nullptr;    // [64]
    const float* log_peak = nullptr;          // [64]
    int channels = 3;
};

// Row pointers at the cell's first pixel; each 64 floats. See kde::PixelLight.
struct LightRows {
    float* weighted_value = nullptr;
    float* weighted_energy = nullptr;
    float* factor = nullptr;
    float* residual = nullptr;
    float* product = nullptr;
    float* energy = nullptr;
    float* square = nullptr;
};

// `groups`: which of the cell's pixels, see kde_evidence.h; the others keep their values.
void fit_light_cell(const EvidenceCell& cell, int groups, const kde::EvidenceParameters& parameters,
                    const LightRows& out);

// The light of the neighbourhoods of kde::kLightRadius around `width` pixels of a row (at most
// kMaxRowPixels); the weighted sums' planes have `stride` floats a row and as many rows and columns around.
void neighbourhood_light(const float* weighted_value, const float* weighted_energy, std::ptrdiff_t stride,
                         int width, float* light);
inline constexpr int kMaxRowPixels = 512;

// What a cell's pixels are and what their neighbourhoods say; `neighbourhood` points into a plane of `stride`
// floats a row that has kde::kLightRadius rows and columns around the cell.
struct LightAround {
    const float* factor = nullptr;
    const float* residual = nullptr;
    const float* neighbourhood = nullptr;
    std::ptrdiff_t stride = 0;
};

// Row pointers at the cell's first pixel. What the shadow rule needs, too: the squared distance from the
// background in bandwidths / 256 and the log density of the colour on the subject.
struct EvidenceRows {
    float* evidence = nullptr;
    float* distance = nullptr;
    float* colour = nullptr;
};

// log_lit: 256 entries, log_foreground: one entry a histogram bin.
void evidence_cell(const EvidenceCell& cell, int groups, const kde::EvidenceParameters& parameters,
                   const LightAround& light, const float* log_lit, const float* log_foreground,
                   const EvidenceRows& out);

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
