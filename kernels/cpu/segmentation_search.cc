#include "kernels/cpu/segmentation_search.h"

#include <bit>
#include <cstring>
#include <vector>

#include "kernels/cpu/run_components.h"
#include "kernels/shared/kde_evidence.h"

namespace kinevox::kernels::cpu {

using kde::kCellPixels;

GroupSpan groups_of_cell(int cell, int groups) {
    const auto bits = static_cast<unsigned>(groups);
    const int first = cell * (kCellPixels / kde::kGroupPixels);
    return {first + std::countr_zero(bits), first + static_cast<int>(std::bit_width(bits))};
}

int groups_near_unsure(const std::uint8_t* density) {
    static_assert(kde::kActiveMargin == sizeof(std::uint32_t) && kde::kSureDensity == 8);
    int slices = 0;
    for (int n = 0; n < kde::kSlices; ++n) {
        std::uint32_t word;
        std::memcpy(&word, density + n * kde::kActiveMargin, sizeof word);
        word &= 0xf8f8f8f8u;  // a byte is 0 where the density is below the sure one
        slices |= ((word - 0x01010101u) & ~word & 0x80808080u) != 0 ? 1 << n : 0;
    }
    return kde::groups_near(slices);
}

void mark_searched(const SegmentationPrior& prior, const CellBox& work, int width, int height,
                   std::uint8_t* searched) {
    const int cells = (width + kCellPixels - 1) / kCellPixels;
    std::memset(searched, 0, static_cast<std::size_t>(cells) * height);
    const auto row_of = [&](int y) { return searched + static_cast<std::ptrdiff_t>(y) * cells; };
    if (work.empty()) return;
    const bool confined =
        !prior.full_pass && !prior.region.empty() && prior.expected && prior.max_distance_px >= 0;
    if (!confined) {
        for (int y = work.y0; y < work.y1; ++y) std::memset(row_of(y) + work.k0, 1, work.k1 - work.k0);
        return;
    }
    const int radius = prior.max_distance_px;
    const Rect& region = prior.region;
    const auto mark = [&](int y, int x0, int x1) {
        const int k0 = std::max(std::max(x0, 0) / kCellPixels, work.k0);
        const int k1 = std::min((std::min(x1, width) + kCellPixels - 1) / kCellPixels, work.k1);
        if (k0 < k1) std::memset(row_of(y) + k0, 1, k1 - k0);
    };
    // Along the rows, then down and up: a cell's value is the number of further rows that it covers.
    std::vector<int> left(cells, 0);
    const auto spread = [&](int y, const std::uint8_t* marked) {
        std::uint8_t* row = row_of(y);
        for (int k = work.k0; k < work.k1; ++k) {
            left[k] = marked[k] ? radius + 1 : left[k];
            if (left[k] > 0) row[k] = 1, --left[k];
        }
    };
    for (int y = std::max(work.y0 - radius, 0); y < std::min(work.y1 + radius, height); ++y)
        for_each_run(prior.expected + static_cast<std::ptrdiff_t>(y) * width, 0, width,
                     [&](int x0, int x1) { mark(y, x0 - radius, x1 + radius); });
    const std::vector<std::uint8_t> marked(searched, searched + static_cast<std::size_t>(cells) * height);
    const auto marked_row = [&](int y) { return marked.data() + static_cast<std::ptrdiff_t>(y) * cells; };
    const int first = std::max(work.y0 - radius, 0), last = std::min(work.y1 + radius, height) - 1;
    for (int y = first; y <= last; ++y) spread(y, marked_row(y));
    std::fill(left.begin(), left.end(), 0);
    for (int y = last; y >= first; --y) spread(y, marked_row(y));
    for (int y = first; y <= last; ++y) {
        if (y < work.y0 || y >= work.y1) {
            std::memset(row_of(y), 0, cells);
            continue;
        }
        if (region.x0 <= 0) mark(y, 0, radius);
        if (region.x1 >= width) mark(y, width - radius, width);
        if ((region.y0 <= 0 && y < radius) || (region.y1 >= height && y >= height - radius))
            mark(y, region.x0, region.x1);
    }
}

}  // namespace kinevox::kernels::cpu
