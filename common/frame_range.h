// Ranges of frames as users write them.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace kinevox {

// From `first` to `last`, both included.
struct FrameRange {
    std::int64_t first = 0;
    std::optional<std::int64_t> last;  // absent: to the end
};

// "30-89", or "30-" to the end; nothing where it is neither, or LAST < FIRST.
std::optional<FrameRange> parse_frame_range(std::string_view text);

}  // namespace kinevox
