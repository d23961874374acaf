#include "kernels/cpu/packed_silhouettes.h"

#include <algorithm>
#include <cstring>

#include "kernels/cpu/parallel.h"
#include "kernels/shared/kde_density.h"

namespace kinevox::kernels::cpu {
namespace {

using kde::kCellPixels;

constexpr int kRowsPerTask = 128;

// Writes `count` pixels, 0 or 255.
void write_pixels(std::uint64_t pixels, int count, std::uint8_t* to) {
    if (pixels == 0 || ~pixels == 0) {
        std::memset(to, pixels == 0 ? 0 : 255, count);
        return;
    }
    for (int i = 0; i < count; i += 8, pixels >>= 8) {
        // Bit n of the lowest byte to byte n.
        const std::uint64_t bits = ((pixels & 255) * 0x0101010101010101u) & 0x8040201008040201u;
        const std::uint64_t bytes = ((bits + 0x7f7f7f7f7f7f7f7fu) >> 7 & 0x0101010101010101u) * 255;
        std::memcpy(to + i, &bytes, std::min(count - i, 8));
    }
}

// Sets pixels [x0, x1) of a row of `dirty` to 0, but for those of `box`, which are written anyway.
void clear_row(std::uint8_t* row, int y, const Rect& dirty, const Rect& box) {
    if (y < dirty.y0 || y >= dirty.y1) return;
    const auto clear = [&](int x0, int x1) {
        if (x0 < x1) std::memset(row + x0, 0, x1 - x0);
    };
    if (y < box.y0 || y >= box.y1) return clear(dirty.x0, dirty.x1);
    clear(dirty.x0, std::min(dirty.x1, box.x0));
    clear(std::max(dirty.x0, box.x1), dirty.x1);
}

}  // namespace

void unpack(const PackedSilhouettes& packed, Silhouettes& out) {
    const std::size_t pixels = static_cast<std::size_t>(packed.width) * packed.height;
    const bool reused = out.width == packed.width && out.height == packed.height;
    for (auto* plane : {&out.probability, &out.sharp, &out.loose})
        if (!reused || plane->size() != pixels) plane->assign(pixels, 0);
    const Rect searched = packed.searched, box = packed.found.empty() ? Rect{} : packed.found;
    const int columns = (searched.width() + kCellPixels - 1) / kCellPixels;
    const Rect old_searched = reused ? out.searched : Rect{}, old_bounds = reused ? out.bounds : Rect{};
    parallel_for(0, packed.height, kRowsPerTask, [&](int first, int last) {
        for (int y = first; y < last; ++y) {
            const std::size_t row = static_cast<std::size_t>(y) * packed.width;
            clear_row(out.probability.data() + row, y, old_searched, box);
            clear_row(out.sharp.data() + row, y, old_bounds, box);
            clear_row(out.loose.data() + row, y, old_bounds, box);
            if (y < box.y0 || y >= box.y1) continue;
            for (int x = box.x0; x < box.x1; x += kCellPixels) {
                const std::size_t cell =
                    static_cast<std::size_t>(y - searched.y0) * columns + (x - searched.x0) / kCellPixels;
                const int count = std::min(kCellPixels, box.x1 - x);
                std::memcpy(out.probability.data() + row + x, packed.probability + cell * kCellPixels, count);
                write_pixels(packed.sharp[cell], count, out.sharp.data() + row + x);
                write_pixels(packed.loose[cell], count, out.loose.data() + row + x);
            }
        }
    });
    out.width = packed.width, out.height = packed.height;
    out.searched = searched;
}

}  // namespace kinevox::kernels::cpu
