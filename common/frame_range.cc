#include "common/frame_range.h"

#include <charconv>

namespace kinevox {
namespace {

constexpr std::int64_t kMaxFrame = 1'000'000'000'000'000;

std::optional<std::int64_t> parse_frame(std::string_view text) {
    std::int64_t frame = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), frame);
    if (error != std::errc{} || end != text.data() + text.size() || frame < 0 || frame > kMaxFrame)
        return std::nullopt;
    return frame;
}

}  // namespace

std::optional<FrameRange> parse_frame_range(std::string_view text) {
    const std::size_t dash = text.find('-');
    if (dash == std::string_view::npos) return std::nullopt;
    const auto first = parse_frame(text.substr(0, dash));
    if (!first) return std::nullopt;
    if (dash + 1 == text.size()) return FrameRange{*first, std::nullopt};
    const auto last = parse_frame(text.substr(dash + 1));
    if (!last || *last < *first) return std::nullopt;
    return FrameRange{*first, *last};
}

}  // namespace kinevox
