#include "kernels/cpu/paint.h"

#include "kernels/shared/colouring.h"

namespace kinevox::kernels {

void paint_brick(std::span<const CellColours> colours, std::span<const ViewOfVolume> of_volume,
                 const Surface& surface, int brick, VoxelVolume& volume) {
    for (int n = surface.first[brick]; n < surface.first[brick + 1]; ++n) {
        const unsigned open = surface.open[n];
        float sum[3] = {}, weights = 0;
        for (std::size_t v = 0; v < of_volume.size(); ++v) {
            const ViewOfVolume& view = of_volume[v];
            const int cell = view.cell[n];
            if (cell < 0 || colours[v].means.empty()) continue;
            float weight = colour_weight(view.facing[open], view.depth_m[n]);
            if (!sees(view, n, open)) weight *= kHiddenWeight;
            const std::uint8_t* mean = colours[v].means.data() + 3 * mean_index(cell, view.cells.width());
            for (int c = 0; c < 3; ++c) sum[c] += weight * static_cast<float>(mean[c]);
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
