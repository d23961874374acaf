#include "kernels/cpu/image_copy.h"

#include <algorithm>
#include <cstring>

#include "kernels/cpu/parallel.h"

namespace kinevox::kernels::cpu {

void copy_image(const ImageView& image, std::uint8_t* to) {
    constexpr std::size_t kPiece = 512 << 10;  // bytes; waking a thread costs as much as some of these
    const std::size_t row_bytes = static_cast<std::size_t>(image.width) * image.channels;
    const int rows = static_cast<int>(std::max<std::size_t>(1, kPiece / row_bytes));
    parallel_for(0, image.height, rows, [&](int first, int last) {
        if (image.stride == static_cast<std::ptrdiff_t>(row_bytes)) {
            std::memcpy(to + first * row_bytes, image.row(first), (last - first) * row_bytes);
            return;
        }
        for (int y = first; y < last; ++y) std::memcpy(to + y * row_bytes, image.row(y), row_bytes);
    });
}

}  // namespace kinevox::kernels::cpu
