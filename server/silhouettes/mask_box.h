// Masks of whole images that are 0 outside a box, so that only the box has to be visited. Inline.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "kernels/types.h"

namespace kinevox {

// Rows of `width` bytes, no padding; the box lies in the image.
inline void fill_box(std::vector<std::uint8_t>& mask, int width, const kernels::Rect& box,
                     std::uint8_t value) {
    for (int y = box.y0; y < box.y1; ++y)
        std::fill_n(mask.data() + static_cast<std::size_t>(y) * width + box.x0, box.width(), value);
}
inline void clear_box(std::vector<std::uint8_t>& mask, int width, const kernels::Rect& box) {
    fill_box(mask, width, box, 0);
}

// Sets in `into` what `mask` sets inside the box.
inline void add_box(const std::vector<std::uint8_t>& mask, int width, const kernels::Rect& box,
                    std::vector<std::uint8_t>& into) {
    for (int y = box.y0; y < box.y1; ++y) {
        const std::size_t row = static_cast<std::size_t>(y) * width;
        for (int x = box.x0; x < box.x1; ++x) into[row + x] |= mask[row + x];
    }
}

}  // namespace kinevox
