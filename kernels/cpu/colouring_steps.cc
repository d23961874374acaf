#include "kernels/cpu/colouring_steps.h"

#include <algorithm>
#include <limits>
#include <vector>

#include "kernels/shared/colouring.h"

namespace kinevox::kernels {

Rect bounds_of(const std::uint8_t* mask, int width, int height) {
    Rect box{width, height, 0, 0};
    for (int y = 0; y < height; ++y) {
        const std::uint8_t* row = mask + static_cast<std::size_t>(y) * width;
        const std::uint8_t* const end = row + width;
        const std::uint8_t* first = std::find_if(row, end, [](std::uint8_t value) { return value != 0; });
        if (first == end) continue;
        int last = width - 1;
        while (row[last] == 0) --last;
        box.x0 = std::min(box.x0, static_cast<int>(first - row));
        box.x1 = std::max(box.x1, last + 1);
        box.y0 = std::min(box.y0, y);
        box.y1 = y + 1;
    }
    return box.x1 > box.x0 ? box : Rect{};
}

float silhouette_iou(const ColouringView& view, const ViewOfVolume& of_volume) {
    constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
    const std::uint8_t* const mask = view.sharp ? view.sharp : view.silhouette;
    if (!mask) return kNothing;
    const int width = of_volume.camera.width, height = of_volume.camera.height;
    const int columns = of_volume.cells.width(), rows = of_volume.cells.height(), shift = of_volume.shift;
    const int radius = of_volume.radius;
    std::int64_t both = 0, silhouette = 0, projection = 0;
    Rect box = view.bounds.empty() ? Rect{0, 0, width, height} : view.bounds;
    for (int y = std::max(box.y0, 0); y < std::min(box.y1, height); ++y) {
        const std::uint8_t* row = mask + static_cast<std::size_t>(y) * width;
        int here = 0;
        for (int x = std::max(box.x0, 0); x < std::min(box.x1, width); ++x) here += row[x] != 0;
        silhouette += here;
    }
    // The splats widened the projection by `radius` cells; eroding it again closes the surface's pinholes
    // without enlarging it.
    std::vector<std::uint8_t> worst(columns), narrow(columns),
        wide(static_cast<std::size_t>(columns) << shift);
    for (int cy = 0; cy < rows; ++cy) {
        if (of_volume.spans[cy].first >= of_volume.spans[cy].last) continue;
        std::fill(worst.begin(), worst.end(), std::uint8_t{1});
        for (int from = std::max(cy - radius, 0); from <= std::min(cy + radius, rows - 1); ++from) {
            const DepthCell* depths = of_volume.depths.data() + static_cast<std::size_t>(from) * columns;
            for (int x = 0; x < columns; ++x) worst[x] &= !depths[x].empty();
        }
        std::copy(worst.begin(), worst.end(), narrow.begin());
        for (int step = 1; step <= radius && step < columns; ++step) {
            for (int x = 0; x < columns - step; ++x) narrow[x] &= worst[x + step];
            for (int x = step; x < columns; ++x) narrow[x] &= worst[x - step];
        }
        const int y0 = (cy + of_volume.cells.y0) << shift, x0 = of_volume.cells.x0 << shift;
        const int end = std::min(columns << shift, width - x0);
        for (int x = 0; x < end; ++x) wide[x] = narrow[x >> shift];
        int covered = 0;
        for (int x = 0; x < end; ++x) covered += wide[x];
        if (covered == 0) continue;
        for (int y = y0; y < std::min(y0 + (1 << shift), height); ++y) {
            const std::uint8_t* row = mask + static_cast<std::size_t>(y) * width + x0;
            int shared = 0;
            for (int x = 0; x < end; ++x) shared += wide[x] & (row[x] != 0);
            projection += covered;
            both += shared;
        }
    }
    const std::int64_t either = silhouette + projection - both;
    return either > 0 ? static_cast<float>(both) / static_cast<float>(either) : kNothing;
}

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
