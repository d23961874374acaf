#include "kernels/cpu/run_components.h"

#include <algorithm>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

namespace kinevox::kernels::cpu {

std::uint64_t set_pixels(const std::uint8_t* row, int x, int end) {
    const int count = std::min(end - x, 64);
    if (count < 64 && end < 64) {  // nothing to read whole vectors from
        std::uint64_t bits = 0;
        for (int i = 0; i < count; ++i) bits |= static_cast<std::uint64_t>(row[x + i] != 0) << i;
        return bits;
    }
    const std::uint8_t* const from = row + x - (64 - count);
    std::uint64_t bits = 0;
#ifdef __SSE2__
    for (int part = 0; part < 4; ++part) {
        const __m128i pixels = _mm_loadu_si128(reinterpret_cast<const __m128i*>(from + 16 * part));
        const int unset = _mm_movemask_epi8(_mm_cmpeq_epi8(pixels, _mm_setzero_si128()));
        bits |= static_cast<std::uint64_t>(~unset & 0xffff) << (16 * part);
    }
#else
    for (int i = 0; i < 64; ++i) bits |= static_cast<std::uint64_t>(from[i] != 0) << i;
#endif
    return bits >> (64 - count);
}

int RunComponents::root(int i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
}

template <bool kSet>
void RunComponents::find_runs(const std::uint8_t* mask, int stride, const Rect& box, bool eight_connected) {
    const int gap = eight_connected ? 1 : 0;
    std::size_t above_begin = 0, above_end = 0;
    for (int y = box.y0; y < box.y1; ++y) {
        const std::size_t row_begin = runs.size();
        std::size_t above = above_begin;
        for_each_run<kSet>(mask + static_cast<std::ptrdiff_t>(y) * stride, box.x0, box.x1,
                           [&](int x, int end) {
                               const int index = static_cast<int>(runs.size());
                               runs.push_back({y, x, end, index});
                               parent_.push_back(index);
                               while (above < above_end && runs[above].x1 + gap <= x) ++above;
                               for (std::size_t a = above; a < above_end && runs[a].x0 < end + gap; ++a) {
                                   const int low = std::min(root(static_cast<int>(a)), root(index));
                                   const int high = std::max(root(static_cast<int>(a)), root(index));
                                   parent_[high] = low;
                               }
                           });
        above_begin = row_begin;
        above_end = runs.size();
    }
}

void RunComponents::find(const std::uint8_t* mask, int stride, const Rect& box, bool set,
                         bool eight_connected) {
    runs.clear();
    components.clear();
    parent_.clear();
    if (set)
        find_runs<true>(mask, stride, box, eight_connected);
    else
        find_runs<false>(mask, stride, box, eight_connected);
    for (std::size_t i = 0; i < runs.size(); ++i) {
        const int top = root(static_cast<int>(i));
        Run& run = runs[i];
        if (top == static_cast<int>(i)) {
            run.component = static_cast<int>(components.size());
            components.push_back({0, false, {run.x0, run.y, run.x1, run.y + 1}});
        } else {
            run.component = runs[top].component;
        }
        Component& of = components[run.component];
        of.area += run.x1 - run.x0;
        of.bounds = {std::min(of.bounds.x0, run.x0), std::min(of.bounds.y0, run.y),
                     std::max(of.bounds.x1, run.x1), std::max(of.bounds.y1, run.y + 1)};
        of.touches_border = of.touches_border || run.x0 == box.x0 || run.x1 == box.x1 || run.y == box.y0 ||
                            run.y + 1 == box.y1;
    }
}

}  // namespace kinevox::kernels::cpu
