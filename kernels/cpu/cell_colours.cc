#include "kernels/cpu/cell_colours.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace kinevox::kernels {
namespace {

// One row of cells with a rim of one on each side: 3 channels interleaved. The rim repeats the picture's border.
void cell_row(const PictureView& picture, int shift, int row, const Rect& cells, std::uint8_t* out) {
    const int edge = 1 << shift;
    const int rows = ((picture.height - 1) >> shift) + 1, columns = ((picture.width - 1) >> shift) + 1;
    row = std::clamp(row, 0, rows - 1);
    const int y0 = row << shift, y1 = std::min(y0 + edge, picture.height);
    for (int n = -1; n <= cells.width(); ++n) {
        const int column = std::clamp(cells.x0 + n, 0, columns - 1);
        const int x0 = column << shift, x1 = std::min(x0 + edge, picture.width);
        std::uint8_t* to = out + 3 * (n + 1);
        if (shift == 0) {
            const std::uint8_t* from = picture.row(y0) + static_cast<std::ptrdiff_t>(x0) * picture.channels;
            for (int c = 0; c < 3; ++c) to[c] = from[picture.channels == 3 ? c : 0];
            continue;
        }
        unsigned sum[3] = {};
        for (int y = y0; y < y1; ++y) {
            const std::uint8_t* from = picture.row(y);
            for (int x = x0; x < x1; ++x) {
                for (int c = 0; c < 3; ++c) {
                    sum[c] += from[static_cast<std::ptrdiff_t>(x) * picture.channels + (picture.channels == 3 ? c : 0)];
                }
            }
        }
        const unsigned count = static_cast<unsigned>((y1 - y0) * (x1 - x0));
        for (int c = 0; c < 3; ++c) to[c] = static_cast<std::uint8_t>((sum[c] + count / 2) / count);
    }
}

}  // namespace

void make_cell_colours(const PictureView& picture, int shift, const Rect& cells, std::vector<CellColour>& out,
                       std::vector<std::uint8_t>& scratch) {
    const int width = cells.width(), height = cells.height();
    out.assign(static_cast<std::size_t>(width) * height, CellColour{});
    if (!picture.data || cells.empty()) return;
    const int length = 3 * (width + 2);
    scratch.resize(static_cast<std::size_t>(length) * 3);
    std::array<std::uint8_t*, 3> rows{scratch.data(), scratch.data() + length, scratch.data() + 2 * length};
    cell_row(picture, shift, cells.y0 - 1, cells, rows[0]);
    cell_row(picture, shift, cells.y0, cells, rows[1]);
    std::vector<float> sum(length), square(length), mean(length), deviation(length);
    for (int y = 0; y < height; ++y) {
        cell_row(picture, shift, cells.y0 + y + 1, cells, rows[2]);
        const std::uint8_t *above = rows[0], *here = rows[1], *below = rows[2];
        for (int n = 0; n < length; ++n) {
            const float a = above[n], b = here[n], c = below[n];
            sum[n] = a + b + c;
            square[n] = a * a + b * b + c * c;
        }
        for (int n = 3; n < length - 3; ++n) {
            const float m = (sum[n - 3] + sum[n] + sum[n + 3]) * (1 / 9.f);
            const float variance = (square[n - 3] + square[n] + square[n + 3]) * (1 / 9.f) - m * m;
            mean[n] = m + 0.5f;
            deviation[n] = std::sqrt(variance > 0 ? variance : 0.f) + 0.5f;
        }
        CellColour* row = out.data() + static_cast<std::size_t>(y) * width;
        for (int x = 0; x < width; ++x) {
            for (int c = 0; c < 3; ++c) {
                row[x].mean[c] = static_cast<std::uint8_t>(mean[3 * (x + 1) + c]);
                row[x].deviation[c] = static_cast<std::uint8_t>(deviation[3 * (x + 1) + c]);
            }
            row[x].filled = 1;
        }
        std::rotate(rows.begin(), rows.begin() + 1, rows.end());
    }
}

}  // namespace kinevox::kernels
