// What is computed for a pixel's neighbours, too: the rows of the active groups and around them.
#pragma once

#include <algorithm>
#include <span>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/segmentation_evidence.h"
#include "kernels/cpu/segmentation_search.h"

namespace kinevox::kernels::cpu {

// Calls f(y, x, count) for the pixels of the groups in `spans` (per row of the image, those of `box` count)
// and `radius` pixels above, below and beside them, in parallel, at most kMaxRowPixels at a time.
template <typename F>
void for_rows_around(std::span<const GroupSpan> spans, const CellBox& box, int radius, int rows_per_task,
                     const F& f) {
    const auto span_of = [&](int y) { return y < box.y0 || y >= box.y1 ? GroupSpan{} : spans[y]; };
    parallel_for(box.y0 - radius, box.y1 + radius, rows_per_task, [&](int first, int last) {
        for (int y = first; y < last; ++y) {
            GroupSpan span;
            for (const int dy : {-radius, 0, radius}) span.include(span_of(y + dy));
            if (span.empty()) continue;
            const int x1 = span.g1 * kde::kGroupPixels + radius;
            for (int x = span.g0 * kde::kGroupPixels - radius; x < x1; x += kMaxRowPixels)
                f(y, x, std::min(x1 - x, kMaxRowPixels));
        }
    });
}

}  // namespace kinevox::kernels::cpu
