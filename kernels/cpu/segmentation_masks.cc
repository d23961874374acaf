#include "kernels/cpu/segmentation_masks.h"

#include <algorithm>
#include <cstring>

#include "kernels/cpu/border_unmixing.h"
#include "kernels/cpu/parallel.h"

namespace kinevox::kernels::cpu {
namespace {

constexpr std::size_t kReadBeyond = 8;  // bytes, by vectors at the image's end

void set_run(const MaskImage& mask, const Run& run, int value) {
    std::memset(mask.row(run.y) + run.x0, value, run.x1 - run.x0);
}

// One step of a diamond: each pixel becomes the AND (shrink) or OR (grow) of itself and its four neighbours.
// Pixels outside the image count as itself.
template <bool kShrink>
void diamond_step(const MaskImage& from, std::uint8_t* to, const Rect& box) {
    for (int y = box.y0; y < box.y1; ++y) {
        const std::uint8_t* here = from.row(y);
        const std::uint8_t* above = from.row(std::max(y - 1, 0));
        const std::uint8_t* below = from.row(std::min(y + 1, from.height - 1));
        std::uint8_t* out = to + static_cast<std::ptrdiff_t>(y) * from.width;
        const auto join = [](int a, int b) { return kShrink ? a & b : a | b; };
        const int first = std::max(box.x0, 1), last = std::min(box.x1, from.width - 1);
#pragma GCC ivdep
        for (int x = first; x < last; ++x)
            out[x] = static_cast<std::uint8_t>(
                join(join(here[x], join(above[x], below[x])), join(here[x - 1], here[x + 1])));
        if (box.x0 == 0) out[0] = static_cast<std::uint8_t>(join(here[0], join(above[0], below[0])));
        if (box.x1 == from.width)
            out[last] = static_cast<std::uint8_t>(join(here[last], join(above[last], below[last])));
    }
}

}  // namespace

Rect grown(const Rect& box, int margin, int width, int height) {
    if (box.empty()) return {};
    return {std::max(box.x0 - margin, 0), std::max(box.y0 - margin, 0), std::min(box.x1 + margin, width),
            std::min(box.y1 + margin, height)};
}

std::int64_t remove_small_components(const MaskImage& mask, const Rect& box, int min_area, float min_fraction,
                                     const std::uint8_t* seed, RunComponents& scratch) {
    scratch.find(mask.data, mask.width, box, true, true);
    std::vector<std::uint8_t> kept(scratch.components.size(), seed == nullptr);
    if (seed)
        for (const Run& run : scratch.runs) {
            if (kept[run.component]) continue;
            const std::uint8_t* begin = seed + static_cast<std::ptrdiff_t>(run.y) * mask.width;
            kept[run.component] =
                std::any_of(begin + run.x0, begin + run.x1, [](std::uint8_t s) { return s != 0; });
        }
    std::int64_t largest = 0;
    for (std::size_t i = 0; i < scratch.components.size(); ++i)
        if (kept[i]) largest = std::max(largest, scratch.components[i].area);
    const auto bound =
        std::max<double>(min_area, static_cast<double>(min_fraction) * static_cast<double>(largest));
    for (const Run& run : scratch.runs)
        if (!kept[run.component] || static_cast<double>(scratch.components[run.component].area) < bound)
            set_run(mask, run, 0);
    return largest;
}

void fill_holes(const MaskImage& mask, const Rect& box, int max_area, RunComponents& scratch) {
    scratch.find(mask.data, mask.width, box, false, false);
    for (const Run& run : scratch.runs) {
        const Component& hole = scratch.components[run.component];
        if (hole.area < max_area && !hole.touches_border) set_run(mask, run, 255);
    }
}

void BorderRefiner::refine(const MaskImage& sharp, const Rect& box, const Rect& limit,
                           const BackgroundModel& model, const std::uint8_t* cells,
                           const kde::BorderParameters& parameters) {
    if (box.empty()) return;
    const std::size_t bytes = static_cast<std::size_t>(sharp.width) * sharp.height;
    for (auto* plane : {&inside_, &grown_, &scratch_, &zones_}) plane->resize(bytes + kReadBeyond);
    const int margin_px = kde::kBorderRadius + kde::kBorderDepth;
    const Rect wide = grown(box, margin_px, sharp.width, sharp.height);
    const MaskImage scratch{scratch_.data(), sharp.width, sharp.height};
    static_assert(kde::kBorderDepth == 2);
    diamond_step<true>(sharp, scratch_.data(), wide);
    diamond_step<true>(scratch, inside_.data(), wide);
    diamond_step<false>(sharp, scratch_.data(), wide);
    diamond_step<false>(scratch, grown_.data(), wide);
    for (int y = wide.y0; y < wide.y1; ++y) {
        const std::size_t row = static_cast<std::size_t>(y) * sharp.width;
        const std::uint8_t *inside = inside_.data() + row, *grown = grown_.data() + row;
        std::uint8_t* zones = zones_.data() + row;
#pragma GCC ivdep
        for (int x = wide.x0; x < wide.x1; ++x)
            zones[x] =
                static_cast<std::uint8_t>((inside[x] & kde::kZoneInside) | (~grown[x] & kde::kZoneOutside));
    }
    const BorderImages images{
        sharp.width,         limit,          zones_.data(), cells, model.reference.data(),
        model.cells_per_row, model.channels, parameters};
    parallel_for(box.y0, box.y1, 16, [&](int first, int last) {
        for (int y = first; y < last; ++y) unmix_row(images, y, box.x0, box.x1, sharp.row(y));
    });
}

}  // namespace kinevox::kernels::cpu
