// Connected components of a mask by runs: cheap on silhouettes, whose rows hold few runs.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/types.h"

namespace kinevox::kernels::cpu {

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
