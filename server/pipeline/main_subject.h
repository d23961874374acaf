// Who of what stands out in a picture is the person.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace kinevox {

// The largest island of `mask` (rows of `width`, without padding; anything but 0 is set) and the islands
// beside it, as a hand in front of a door frame is one: 0 or 255, of the mask's size. Empty where the largest
// is too small to be a person.
std::vector<std::uint8_t> main_subject(std::span<const std::uint8_t> mask, int width, int height);

}  // namespace kinevox
