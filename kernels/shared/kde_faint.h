// Faint blocks: squares of pixels whose mean differs from the background by less than the density of a single
// pixel shows, but by more than the background's own means do in this image. Clothes in the background's
// colours consist of them, so their pixels are not plain background: the rule of kde_shadow.h decides them.
#pragma once

#include <cstdint>

#include "kernels/shared/device.h"
#include "kernels/shared/kde_density.h"
#include "kernels/shared/kde_scene.h"

namespace kinevox::kernels::kde {

inline constexpr int kFaintBlock_px = kVoteBlock_px;
inline constexpr int kFaintBlocks = kCellPixels / kFaintBlock_px;  // of a cell
inline constexpr int kFaintPixels = kFaintBlock_px * kFaintBlock_px;

// A pixel's difference from the background in a channel, bandwidths / 256.
KINEVOX_HD inline int scaled_difference(int value, int reference, int scale) {
    constexpr int kLimit = 4095;
    const int difference = (value - reference) * scale;
    return difference < -kLimit ? -kLimit : difference > kLimit ? kLimit : difference;
}

// Squared differences from the background, summed over the channels, (bandwidths / 256)^2.
struct BlockDifference {
    int mean = 0;   // of the block's mean
    int pixel = 0;  // of its pixels, on average
};

// `sum` and `squares`: of the scaled differences of a block in a channel.
KINEVOX_HD inline void add_channel(BlockDifference& block, int sum, int squares) {
    const int mean = sum / kFaintPixels;
    block.mean += mean * mean;
    block.pixel += squares / kFaintPixels;
}

// The medians over the background come from histograms of these blocks: all of every n-th row of blocks.
inline constexpr int kNoiseBins = 1024;
inline constexpr int kMeanBinShift = 5, kPixelBinShift = 8;
KINEVOX_HD inline int noise_row_step(int block_rows) {
    constexpr int kRows = 12;
    return block_rows > kRows ? block_rows / kRows : 1;
}
KINEVOX_HD inline int noise_bin(int value, int shift) {
    const int bin = value >> shift;
    return bin < kNoiseBins ? bin : kNoiseBins - 1;
}

// The usual difference of an image's blocks, from the bins that hold the medians. Limited below, since noise
// of a part of a grey level says nothing about slow changes of the light.
KINEVOX_HD inline BlockDifference usual_difference(int mean_bin, int pixel_bin, int channels) {
    constexpr int kMinMean = 400, kMinPixel = 1285;  // of a channel: a fifth and a third of a grey level
    const int mean = (mean_bin << kMeanBinShift) + (1 << (kMeanBinShift - 1)),
              pixel = (pixel_bin << kPixelBinShift) + (1 << (kPixelBinShift - 1));
    return {mean > kMinMean * channels ? mean : kMinMean * channels,
            pixel > kMinPixel * channels ? pixel : kMinPixel * channels};
}

KINEVOX_HD inline bool is_faint(const BlockDifference& block, const BlockDifference& usual) {
    constexpr int kMinRatio = 6;
    return block.mean > kMinRatio * usual.mean;
}

// What the rule multiplies squared distances by, so that it counts in the image's own noise instead of the
// assumed variance, `noise_fraction` of the squared bandwidth.
KINEVOX_HD inline float noise_factor(const BlockDifference& usual, int channels, float noise_fraction) {
    return noise_fraction * 65536.0f * static_cast<float>(channels) / static_cast<float>(usual.pixel);
}

}  // namespace kinevox::kernels::kde
