// The loops over pixels of the shadow rule (shared/kde_shadow.h), compiled for each processor family where
// Highway is there.
#pragma once

#include <cstddef>
#include <cstdint>

#include "kernels/shared/kde_shadow.h"

namespace kinevox::kernels::cpu {

// Floats after a group's last block that are read and not used.
inline constexpr int kBlockPadding = kde::kGroupPixels;

// 16 pixels of a row.
struct ShadowGroup {
    kde::ShadowPixels pixels;
    float noise_factor = 1;                                  // see kde::noise_factor()
    int view_count = 0;                                      // other cameras
    const float* floor_light[kde::kMaxFloorViews];           // of its blocks; negative: not known
    const float* support = nullptr;                          // of its halves
    const float *distance = nullptr, *colour = nullptr;      // see EvidenceRows
    float own[kde::kGroupPixels], voted[kde::kGroupPixels];  // see kde::ShadowLogOdds
    bool with_features = false;
    float features[kde::kShadowFeatures][kde::kGroupPixels];
};

// Which of 16 pixels are doubtful, as bits. On a little-endian machine.
unsigned doubtful_pixels(const std::uint8_t* density, const float* evidence);

// Fills own and voted, and features if they are wanted.
void shadow_group(int channels, const kde::ShadowRule& rule, ShadowGroup& group);

// The misfit of the light that fits a patch of 7 x 7 best, per channel and pixel, around `width` pixels of a
// row (at most kMaxRowPixels); the planes have `stride` floats a row.
void misfit_row(const float* product, const float* energy, const float* square, std::ptrdiff_t stride,
                int width, int channels, float* misfit);

}  // namespace kinevox::kernels::cpu
