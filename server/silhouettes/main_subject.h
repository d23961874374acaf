// Selects the person among the foreground components of a mask.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace kinevox {

// The largest component of `mask` (rows of `width`, no padding; non-zero is foreground) and the components
// next to it, which may be parts of the same person separated by an occlusion. The result is 0 or 255, of the
// mask's size; empty if the largest component is too small to be a person.
std::vector<std::uint8_t> main_subject(std::span<const std::uint8_t> mask, int width, int height);

}  // namespace kinevox
