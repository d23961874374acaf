#include "kernels/cpu/upload_work.h"

#include <algorithm>
#include <cstring>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/run_components.h"

namespace kinevox::kernels::cpu {

void copy_rows(const ImageView& image, int y0, int y1, std::uint8_t* to) {
    constexpr std::size_t kPiece = 128 << 10;  // bytes
    const std::size_t row_bytes = static_cast<std::size_t>(image.width) * image.channels;
    const int rows = static_cast<int>(std::max<std::size_t>(1, kPiece / row_bytes));
    parallel_for(y0, y1, rows, [&](int first, int last) {
        if (image.stride == static_cast<std::ptrdiff_t>(row_bytes)) {
            std::memcpy(to + first * row_bytes, image.row(first), (last - first) * row_bytes);
            return;
        }
        for (int y = first; y < last; ++y) std::memcpy(to + y * row_bytes, image.row(y), row_bytes);
    });
}

void pack_mask(const std::uint8_t* mask, int width, int height, unsigned long long* words) {
    constexpr int kWord = 64;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; x += kWord)
            *words++ = set_pixels(mask + static_cast<std::size_t>(y) * width, x, width);
}

void run_all(std::span<const std::function<void()>> tasks) {
    parallel_for(0, static_cast<int>(tasks.size()), 1, [&](int n, int) { tasks[n](); });
}

}  // namespace kinevox::kernels::cpu
