// Masks of whole images that are 0 outside a box, so that only the box has to be visited. Inline.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "kernels/types.h"

namespace kinevox {

// Rows of `width` bytes, no padding; the box lies in the image.
inline void clear_box(std::vector<std::uint8_t>& mask, int width, const kernels::Rect& box) {
    for (int y = box.y0; y < box.y1; ++y)
        std::fill_n(mask.data() + static_cast<std::size_t>(y) * width + box.x0, box.width(), std::uint8_t{0});
}

inline void fill_box(const kernels::Rect& box, int width, std::vector<std::uint8_t>& mask) {
    for (int y = box.y0; y < box.y1; ++y)
        std::fill_n(mask.data() + static_cast<std::size_t>(y) * width + box.x0, box.width(),
                    std::uint8_t{255});
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
