// Connected components of a mask by runs: cheap on silhouettes, whose rows hold few runs.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

#include "kernels/types.h"

namespace kinevox::kernels::cpu {

// Bit i: whether row[x + i] is not 0, for i < min(64, end - x); the bits above are 0. `row` is a image's
// row from its first column on.
std::uint64_t set_pixels(const std::uint8_t* row, int x, int end);

// Calls body(x0, x1) for the runs in [x, end) of pixels that are not 0, or that are where `kSet` is false. 64
// pixels at once: rows are mostly uniform.
template <bool kSet = true, class F>
void for_each_run(const std::uint8_t* row, int x, int end, F body) {
    int first = 0;
    bool inside = false;  // a run that began at `first`
    for (; x < end; x += 64) {
        std::uint64_t bits = set_pixels(row, x, end);
        if (!kSet) bits = end - x < 64 ? ~bits & ((std::uint64_t{1} << (end - x)) - 1) : ~bits;
        if (inside) {
            const int length = std::countr_one(bits);
            if (length == 64) continue;
            body(first, x + length);
            inside = false;
            bits &= ~std::uint64_t{0} << length;
        }
        while (bits != 0) {
            const int begin = std::countr_zero(bits), length = std::countr_one(bits >> begin);
            first = x + begin;
            if (begin + length == 64) {
                inside = true;
                break;
            }
            body(first, first + length);
            bits &= ~std::uint64_t{0} << (begin + length);
        }
    }
    if (inside) body(first, end);
}

struct Run {
    int y = 0, x0 = 0, x1 = 0;  // pixels [x0, x1) of a row
    int component = 0;
};

struct Component {
    std::int64_t area = 0;        // px
    bool touches_border = false;  // of the box that was searched
    Rect bounds;
};

// Fills `runs` and `components` with the components of the pixels of `mask` (row y at mask + y * stride)
// inside `box` whose being non-zero equals `set`. Eight-connected or four-connected.
class RunComponents {
  public:
    void find(const std::uint8_t* mask, int stride, const Rect& box, bool set, bool eight_connected);

    std::vector<Run> runs;
    std::vector<Component> components;

  private:
    template <bool kSet>
    void find_runs(const std::uint8_t* mask, int stride, const Rect& box, bool eight_connected);
    int root(int i);
    std::vector<int> parent_;
};

}  // namespace kinevox::kernels::cpu
