#include "kernels/cpu/run_components.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace kinevox::kernels::cpu {

int next_in_row(const std::uint8_t* row, int x, int end, bool set) {
    const std::uint64_t uniform = set ? 0 : ~std::uint64_t{0};
    for (; x + 32 <= end; x += 32) {
        std::uint64_t word[4];
        std::memcpy(word, row + x, 32);
        if (((word[0] ^ uniform) | (word[1] ^ uniform) | (word[2] ^ uniform) | (word[3] ^ uniform)) != 0)
            break;
    }
    for (; x + 8 <= end; x += 8) {
        std::uint64_t word;
        std::memcpy(&word, row + x, 8);
        if (word == uniform) continue;
        if constexpr (std::endian::native == std::endian::little) {
            // The lowest byte that is zero: borrows reach only those above it.
            const std::uint64_t found =
                set ? word : (word - 0x0101010101010101u) & ~word & 0x8080808080808080u;
            if (found != 0) return x + std::countr_zero(found) / 8;
            continue;
        }
        break;
    }
    while (x < end && (row[x] != 0) != set) ++x;
    return x;
}

int RunComponents::root(int i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
}

void RunComponents::find(const std::uint8_t* mask, int stride, const Rect& box, bool set,
                         bool eight_connected) {
    runs.clear();
    components.clear();
    parent_.clear();
    const int reach = eight_connected ? 1 : 0;
    std::size_t above_begin = 0, above_end = 0;
    for (int y = box.y0; y < box.y1; ++y) {
        const std::uint8_t* row = mask + static_cast<std::ptrdiff_t>(y) * stride;
        const std::size_t row_begin = runs.size();
        std::size_t above = above_begin;
        for (int x = next_in_row(row, box.x0, box.x1, set); x < box.x1;) {
            const int end = next_in_row(row, x, box.x1, !set);
            const int index = static_cast<int>(runs.size());
            runs.push_back({y, x, end, index});
            parent_.push_back(index);
            while (above < above_end && runs[above].x1 + reach <= x) ++above;
            for (std::size_t a = above; a < above_end && runs[a].x0 < end + reach; ++a) {
                const int low = std::min(root(static_cast<int>(a)), root(index));
                const int high = std::max(root(static_cast<int>(a)), root(index));
                parent_[high] = low;
            }
            x = next_in_row(row, end, box.x1, set);
        }
        above_begin = row_begin;
        above_end = runs.size();
    }
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
