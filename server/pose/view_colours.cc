#include "server/pose/view_colours.h"

#include <algorithm>

namespace kinevox {

void read_colours(const kernels::ImageView& image, const kernels::Silhouettes& s, int side,
                  ViewColours& out) {
    out.columns = out.rows = 0;
    out.colour.clear(), out.inside.clear();
    const kernels::Rect& b = s.bounds;
    if (!image.data || side <= 0 || b.empty() || s.sharp_pixels <= 0) return;
    out.cell = std::max(1, (std::max(b.width(), b.height()) + side - 1) / side);
    out.x0 = b.x0, out.y0 = b.y0;
    out.columns = (b.width() + out.cell - 1) / out.cell, out.rows = (b.height() + out.cell - 1) / out.cell;
    const std::size_t cells = static_cast<std::size_t>(out.columns) * out.rows;
    out.colour.assign(cells, {}), out.inside.assign(cells, 0);
    for (int r = 0; r < out.rows; ++r)
        for (int c = 0; c < out.columns; ++c) {
            std::array<int, 3> sum{};
            int count = 0;
            const int x_begin = b.x0 + c * out.cell, x_end = std::min(b.x1, x_begin + out.cell),
                      y_begin = b.y0 + r * out.cell, y_end = std::min(b.y1, y_begin + out.cell);
            for (int y = y_begin; y < y_end; ++y) {
                const std::uint8_t* const mask = s.sharp.data() + static_cast<std::ptrdiff_t>(y) * s.width;
                const std::uint8_t* const row = image.row(y);
                for (int x = x_begin; x < x_end; ++x) {
                    if (!mask[x]) continue;
                    const std::uint8_t* const pixel = row + static_cast<std::ptrdiff_t>(x) * image.channels;
                    for (int k = 0; k < 3; ++k) sum[k] += pixel[std::min(k, image.channels - 1)];
                    ++count;
                }
            }
            if (2 * count <= out.cell * out.cell) continue;
            const std::size_t at = static_cast<std::size_t>(r) * out.columns + c;
            for (int k = 0; k < 3; ++k) out.colour[at][k] = static_cast<std::uint8_t>(sum[k] / count);
            out.inside[at] = 1;
        }
}

}  // namespace kinevox
