#include "server/pose/database/silhouette_codec.h"

#include <zstd.h>

namespace kinevox {

void append_bits(const std::vector<std::uint8_t>& mask, std::string& bits) {
    for (std::size_t n = 0; n + 8 <= mask.size(); n += 8) {
        unsigned byte = 0;
        for (unsigned bit = 0; bit < 8; ++bit) byte |= (mask[n + bit] ? 1u : 0u) << bit;
        bits.push_back(static_cast<char>(byte));
    }
}

std::string compress_silhouettes(const std::string& bits) {
    std::string out(ZSTD_compressBound(bits.size()), '\0');
    const std::size_t size = ZSTD_compress(out.data(), out.size(), bits.data(), bits.size(), 3);
    if (ZSTD_isError(size)) return {};  // cannot happen: the bound is enough
    out.resize(size);
    out.shrink_to_fit();
    return out;
}

std::vector<std::uint8_t> unpack_silhouette(const std::string& compressed, int side_px, int index) {
    const std::size_t pixels = static_cast<std::size_t>(side_px) * side_px, bytes = pixels / 8;
    const unsigned long long size = ZSTD_getFrameContentSize(compressed.data(), compressed.size());
    constexpr unsigned long long kMaxSide = 1ull << 24;
    if (size > kMaxSide || index < 0 || (index + 1ull) * bytes > size) return {};
    std::string bits(size, '\0');
    if (ZSTD_decompress(bits.data(), bits.size(), compressed.data(), compressed.size()) != size) return {};
    std::vector<std::uint8_t> mask(pixels);
    for (std::size_t n = 0; n < pixels; ++n)
        mask[n] = (static_cast<unsigned char>(bits[index * bytes + n / 8]) >> (n % 8)) & 1 ? 255 : 0;
    return mask;
}

}  // namespace kinevox
