#include "server/pipeline/tracking/elsewhere.h"

#include <algorithm>
#include <cstdint>
#include <vector>

namespace kinevox {
namespace {

constexpr int kBlock_px = 8, kStep_px = 2;  // of each block every second pixel is read
constexpr std::uint8_t kForeground = 128;   // probability
constexpr int kMinPersonHeight = 12;        // 1/12 of the image height
constexpr int kMinPersonArea = 250;         // 1/250 of its square

struct Blocks {
    int columns = 0, rows = 0;
    std::vector<char> set;  // half of the block or more is foreground
};

Blocks foreground_blocks(const kernels::Silhouettes& s, const kernels::Rect& subject) {
    Blocks out{s.width / kBlock_px, s.height / kBlock_px, {}};
    out.set.assign(static_cast<std::size_t>(out.columns) * out.rows, 0);
    constexpr int kRead = (kBlock_px / kStep_px) * (kBlock_px / kStep_px);
    for (int row = 0; row < out.rows; ++row)
        for (int column = 0; column < out.columns; ++column) {
            const int x0 = column * kBlock_px, y0 = row * kBlock_px;
            if (x0 < subject.x1 && subject.x0 < x0 + kBlock_px && y0 < subject.y1 &&
                subject.y0 < y0 + kBlock_px)
                continue;
            int count = 0;
            for (int y = y0; y < y0 + kBlock_px; y += kStep_px) {
                const std::uint8_t* const line =
                    s.probability.data() + static_cast<std::ptrdiff_t>(y) * s.width;
                for (int x = x0; x < x0 + kBlock_px; x += kStep_px) count += line[x] >= kForeground;
            }
            out.set[static_cast<std::size_t>(row) * out.columns + column] = 2 * count >= kRead;
        }
    return out;
}

// Removes the part around a block from `blocks`; its number of blocks and of rows.
struct Component {
    int blocks = 0, rows = 0;
};
Component remove_component(Blocks& blocks, int first) {
    std::vector<int> part{first};
    blocks.set[first] = 0;
    int top = first / blocks.columns, bottom = top;
    for (std::size_t k = 0; k < part.size(); ++k) {
        const int x = part[k] % blocks.columns, y = part[k] / blocks.columns;
        top = std::min(top, y), bottom = std::max(bottom, y);
        for (int b = std::max(0, y - 1); b <= std::min(blocks.rows - 1, y + 1); ++b)
            for (int a = std::max(0, x - 1); a <= std::min(blocks.columns - 1, x + 1); ++a) {
                const int other = b * blocks.columns + a;
                if (!blocks.set[other]) continue;
                blocks.set[other] = 0;
                part.push_back(other);
            }
    }
    return {static_cast<int>(part.size()), bottom - top + 1};
}

}  // namespace

bool shows_person_outside(const kernels::Silhouettes& s, const kernels::Rect& subject) {
    if (s.probability.empty()) return false;
    Blocks blocks = foreground_blocks(s, subject);
    for (int k = 0; k < static_cast<int>(blocks.set.size()); ++k) {
        if (!blocks.set[k]) continue;
        const Component part = remove_component(blocks, k);
        if (part.rows * kBlock_px * kMinPersonHeight >= s.height &&
            std::int64_t{part.blocks} * kBlock_px * kBlock_px * kMinPersonArea >=
                std::int64_t{s.height} * s.height)
            return true;
    }
    return false;
}

}  // namespace kinevox
