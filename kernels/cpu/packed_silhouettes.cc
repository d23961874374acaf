#include "kernels/cpu/packed_silhouettes.h"

#include <algorithm>
#include <cstring>

#include "kernels/cpu/parallel.h"
#include "kernels/shared/kde_density.h"

namespace kinevox::kernels::cpu {
namespace {

using kde::kCellPixels;

constexpr int kRowsPerTask = 512;  // a task costs as much as unpacking hundreds of rows

// Sets those of a cell's `count` pixels that are in the mask to 255, where all are 0.
void set_pixels(std::uint64_t pixels, int count, std::uint8_t* to) {
    if (pixels == 0) return;
    if (~pixels == 0) {
        std::memset(to, 255, kCellPixels);
        return;
    }
    for (int i = 0; i < count; i += 8, pixels >>= 8) {
        if ((pixels & 255) == 0) continue;
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
            clear_row(out.sharp.data() + row, y, old_bounds, {});
            clear_row(out.loose.data() + row, y, old_bounds, {});
            if (y < box.y0 || y >= box.y1) continue;
            const std::size_t first_cell =
                static_cast<std::size_t>(y - searched.y0) * columns + (box.x0 - searched.x0) / kCellPixels;
            std::memcpy(out.probability.data() + row + box.x0, packed.probability + first_cell * kCellPixels,
                        box.width());
            for (int x = box.x0, n = 0; x < box.x1; x += kCellPixels, ++n) {
                const int count = std::min(kCellPixels, box.x1 - x);
                set_pixels(packed.sharp[first_cell + n], count, out.sharp.data() + row + x);
                set_pixels(packed.loose[first_cell + n], count, out.loose.data() + row + x);
            }
        }
    });
    out.width = packed.width, out.height = packed.height;
    out.searched = searched;
}

}  // namespace kinevox::kernels::cpu
