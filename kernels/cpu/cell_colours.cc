#include "kernels/cpu/cell_colours.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "kernels/cpu/simd.h"
#include "kernels/shared/device.h"

namespace kinevox::kernels {
namespace {

// One row of cells with a rim of one on each side. The rim repeats the image's border. `sums` has room for
// a row of the image's channels.
KINEVOX_INLINE void cell_row(const ImageView& image, int shift, int row, const Rect& cells,
                             std::uint32_t* sums, std::uint8_t* out) {
    const int edge = 1 << shift, channels = image.channels;
    const int rows = ((image.height - 1) >> shift) + 1, columns = ((image.width - 1) >> shift) + 1;
    row = std::clamp(row, 0, rows - 1);
    const int y0 = row << shift, y1 = std::min(y0 + edge, image.height);
    const int first = std::clamp(cells.x0 - 1, 0, columns - 1), last = std::clamp(cells.x1, 0, columns - 1);
    const int x0 = first << shift, x1 = std::min((last + 1) << shift, image.width);
    const int length = (x1 - x0) * channels;
    if (shift == 0 && channels == 3) {
        const std::uint8_t* from = image.row(y0) + static_cast<std::ptrdiff_t>(x0) * 3;
        const int left = 3 * (x0 - (cells.x0 - 1));  // of the rim, where the image ends
        std::copy_n(from, length, out + left);
        for (int n = left - 1; n >= 0; --n) out[n] = out[n + 3];
        for (int n = left + length; n < 3 * (cells.width() + 2); ++n) out[n] = out[n - 3];
        return;
    }
    for (int y = y0; y < y1; ++y) {  // down the columns first: that vectorises
        const std::uint8_t* from = image.row(y) + static_cast<std::ptrdiff_t>(x0) * channels;
        if (y == y0) {
            for (int n = 0; n < length; ++n) sums[n] = from[n];
        } else {
            for (int n = 0; n < length; ++n) sums[n] += from[n];
        }
    }
    const int second = channels == 3 ? 1 : 0, third = channels == 3 ? 2 : 0;
    for (int n = -1; n <= cells.width(); ++n) {
        const int column = std::clamp(cells.x0 + n, 0, columns - 1);
        const int begin = (column << shift) - x0, end = std::min(begin + edge, x1 - x0);
        std::uint32_t b = 0, g = 0, r = 0;
        const std::uint32_t* from = sums + static_cast<std::ptrdiff_t>(begin) * channels;
        for (int x = begin; x < end; ++x, from += channels) b += from[0], g += from[second], r += from[third];
        const auto count = static_cast<std::uint32_t>((y1 - y0) * (end - begin));
        std::uint8_t* to = out + 3 * (n + 1);
        if (count == 1u << (2 * shift)) {
            const std::uint32_t half = count / 2;
            to[0] = static_cast<std::uint8_t>((b + half) >> (2 * shift));
            to[1] = static_cast<std::uint8_t>((g + half) >> (2 * shift));
            to[2] = static_cast<std::uint8_t>((r + half) >> (2 * shift));
        } else {
            to[0] = static_cast<std::uint8_t>((b + count / 2) / count);
            to[1] = static_cast<std::uint8_t>((g + count / 2) / count);
            to[2] = static_cast<std::uint8_t>((r + count / 2) / count);
        }
    }
}

// Mean and std_grey of 3 x 3 cells for the values [begin, end) of one row, three to a cell, from the row
// above on. Whole numbers below 2^24: exact in any order.
KINEVOX_INLINE void spread_row(const std::uint8_t* above, const std::uint8_t* here, const std::uint8_t* below,
                               int begin, int end, float* sum, float* square, std::uint8_t* mean,
                               std::uint8_t* std_grey) {
    for (int n = begin - 3; n < end + 3; ++n) {
        const int a = above[n], b = here[n], c = below[n];
        sum[n] = static_cast<float>(a + b + c);
        square[n] = static_cast<float>(a * a + b * b + c * c);
    }
    for (int n = begin; n < end; ++n) {
        const float m = (sum[n - 3] + sum[n] + sum[n + 3]) * (1 / 9.f);
        const float variance = (square[n - 3] + square[n] + square[n + 3]) * (1 / 9.f) - m * m;
        mean[n] = static_cast<std::uint8_t>(static_cast<int>(m + 0.5f));
        std_grey[n] =
            static_cast<std::uint8_t>(static_cast<int>(std::sqrt(variance > 0 ? variance : 0.f) + 0.5f));
    }
}

KINEVOX_INLINE void make_body(const ImageView& image, const ViewOfVolume& view, const ColourLimits* limits,
                              CellColours& out) {
    const int width = view.cells.width(), height = view.cells.height(), length = 3 * (width + 2);
    out.means.resize(static_cast<std::size_t>(length) * (height + 2));
    std::vector<std::uint32_t> sums(static_cast<std::size_t>(width + 2) * 3 << view.shift);
    for (int y = -1; y <= height; ++y) {
        cell_row(image, view.shift, view.cells.y0 + y, view.cells, sums.data(),
                 out.means.data() + static_cast<std::size_t>(y + 1) * length);
    }
    if (!limits) return;
    out.cells.resize(static_cast<std::size_t>(width) * height);
    std::vector<float> sum(length), square(length);
    std::vector<std::uint8_t> mean(length), std_grey(length);
    for (int y = 0; y < height; ++y) {
        const RowSpan span = view.spans[y];
        if (span.first >= span.last) continue;
        const std::uint8_t* above = out.means.data() + static_cast<std::size_t>(y) * length;
        spread_row(above, above + length, above + 2 * length, 3 * (span.first + 1), 3 * (span.last + 1),
                   sum.data(), square.data(), mean.data(), std_grey.data());
        CellColour* row = out.cells.data() + static_cast<std::size_t>(y) * width;
        for (int x = span.first; x < span.last; ++x) {
            const std::uint8_t *m = &mean[3 * (x + 1)], *d = &std_grey[3 * (x + 1)];
            row[x] = {{m[0], m[1], m[2]}, 1, {(*limits)[d[0]], (*limits)[d[1]], (*limits)[d[2]]}, 0};
        }
    }
}

void make_plain(const ImageView& image, const ViewOfVolume& view, const ColourLimits* limits,
                CellColours& out) {
    make_body(image, view, limits, out);
}

#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2_EXACT void make_avx2(const ImageView& image, const ViewOfVolume& view,
                                  const ColourLimits* limits, CellColours& out) {
    make_body(image, view, limits, out);
}
#endif

}  // namespace

void make_cell_colours(const ImageView& image, const ViewOfVolume& view, const ColourLimits* limits,
                       CellColours& out) {
    out.clear();
    if (!image.data || view.cells.empty()) return;
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) return make_avx2(image, view, limits, out);
#endif
    make_plain(image, view, limits, out);
}

}  // namespace kinevox::kernels
