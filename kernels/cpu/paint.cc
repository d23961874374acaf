#include "kernels/cpu/paint.h"

#include <algorithm>
#include <cmath>

namespace kinevox::kernels {
namespace {

// Mean B, G, R of one cell.
void cell_mean(const PictureView& picture, const ViewOfVolume& view, int cell, float* mean) {
    const int width = view.cells.width();
    const int x0 = (cell % width + view.cells.x0) << view.shift, y0 = (cell / width + view.cells.y0) << view.shift;
    const int x1 = std::min(x0 + (1 << view.shift), picture.width), y1 = std::min(y0 + (1 << view.shift), picture.height);
    unsigned sum[3] = {};
    for (int y = y0; y < y1; ++y) {
        const std::uint8_t* pixel = picture.row(y) + static_cast<std::ptrdiff_t>(x0) * picture.channels;
        for (int x = x0; x < x1; ++x, pixel += picture.channels) {
            for (int c = 0; c < 3; ++c) sum[c] += pixel[picture.channels == 3 ? c : 0];
        }
    }
    const float count = static_cast<float>((x1 - x0) * (y1 - y0));
    for (int c = 0; c < 3; ++c) mean[c] = static_cast<float>(sum[c]) / count;
}

}  // namespace

void paint_brick(std::span<const ColouringView> views, const std::vector<ViewOfVolume>& of_volume,
                 VoxelVolume& volume, const Surface& surface, int brick) {
    for (int n = surface.first[brick]; n < surface.first[brick + 1]; ++n) {
        float normal[3];
        open_normal(surface.open[n], normal);
        float sum[3] = {}, weights = 0;
        for (std::size_t v = 0; v < views.size(); ++v) {
            const ViewOfVolume& view = of_volume[v];
            const int cell = view.cell[n];
            if (cell < 0 || !views[v].picture.data) continue;
            float weight = colour_weight(facing_of(view.camera, normal), view.depth_m[n]);
            if (!sees(view, n, normal, volume.lattice.voxel_m)) weight *= kHiddenWeight;
            float mean[3];
            cell_mean(views[v].picture, view, cell, mean);
            for (int c = 0; c < 3; ++c) sum[c] += weight * mean[c];
            weights += weight;
        }
        Colour colour;
        if (weights > 0) {
            const auto value = [&](int c) { return static_cast<std::uint8_t>(sum[c] / weights + 0.5f); };
            colour = {value(2), value(1), value(0)};
        }
        volume.colours[n] = colour;
    }
}

}  // namespace kinevox::kernels
