// What the CPU and the CUDA form of the moments share: the grid over the disk's square and a pixel's part of
// a cell.
#pragma once

#include "kernels/moments.h"
#include "kernels/shared/device.h"

namespace kinevox::kernels {

// Rows or columns of pixels that overlap one row or column of the grid. Pixel n spans [n, n + 1) here.
struct CellSpan {
    float begin, end;  // px, within the bounds; empty where end <= begin
};

KINEVOX_HD KINEVOX_INLINE CellSpan cell_span(float centre_px, float radius_px, int grid, int cell, int low,
                                             int high) {
    const float corner = centre_px + 0.5f - radius_px, size = 2 * radius_px / static_cast<float>(grid);
    CellSpan span{corner + size * static_cast<float>(cell), corner + size * static_cast<float>(cell + 1)};
    if (span.begin < static_cast<float>(low)) span.begin = static_cast<float>(low);
    if (span.end > static_cast<float>(high)) span.end = static_cast<float>(high);
    return span;
}

// How much of pixel n lies in the span, 0..1.
KINEVOX_HD KINEVOX_INLINE float pixel_coverage(const CellSpan& span, int n) {
    const float begin = span.begin > static_cast<float>(n) ? span.begin : static_cast<float>(n);
    const float end = span.end < static_cast<float>(n + 1) ? span.end : static_cast<float>(n + 1);
    return end > begin ? end - begin : 0.f;
}

// The basis is even or odd in x and in y, so one quadrant of the grid is enough once the silhouette was
// folded: cos(q theta) with q even, q odd, sin(q theta) with q even, q odd.
enum MomentFold : int { kCosEven, kCosOdd, kSinEven, kSinOdd, kMomentFolds };

// of the cells at (+x, +y), (-x, +y), (+x, -y), (-x, -y).
KINEVOX_HD KINEVOX_INLINE float folded(int fold, float pp, float np, float pn, float nn) {
    const float right_down = fold == kCosEven || fold == kSinOdd ? pp + np : pp - np;
    const float right_up = fold == kCosEven || fold == kSinOdd ? pn + nn : pn - nn;
    return fold == kCosEven || fold == kCosOdd ? right_down + right_up : right_down - right_up;
}

}  // namespace kinevox::kernels
