// Connected components of a mask by runs: cheap on silhouettes, whose rows hold few runs.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/types.h"

namespace kinevox::kernels::cpu {

// First x in [x, end) where (row[x] != 0) == set, else `end`. Eight pixels at once: rows are mostly uniform.
int next_in_row(const std::uint8_t* row, int x, int end, bool set);

// Calls body(x0, x1) for the runs of non-zero pixels in [x, end).
template <class F>
void for_each_run(const std::uint8_t* row, int x, int end, F body) {
    for (x = next_in_row(row, x, end, true); x < end;) {
        const int x1 = next_in_row(row, x, end, false);
        body(x, x1);
        x = next_in_row(row, x1, end, true);
    }
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
    int root(int i);
    std::vector<int> parent_;
};

}  // namespace kinevox::kernels::cpu
